"""The few MAVLink messages that matter here, as records in SI units and still in NED and FRD axes."""

import msgspec

from edge_runtime.messages import Vector2
from firmware_bridge.kinematics.frames import Quaternion, Vector3


class Heartbeat(msgspec.Struct, frozen=True, gc=False):
    """What an autopilot says of itself: the only proof of its mode and arming."""

    custom_mode: int
    armed: bool
    kind: int
    """MAV_TYPE."""
    autopilot: int
    """MAV_AUTOPILOT."""
    status: int
    """MAV_STATE."""


class Attitude(msgspec.Struct, frozen=True, gc=False):
    """Yaw from north, clockwise, and its rate."""

    boot_s: float
    yaw_rad: float
    yaw_rate_rad_s: float


class LocalPosition(msgspec.Struct, frozen=True, gc=False):
    """Position and velocity, (north, east) from the estimator's origin."""

    boot_s: float
    position_m: Vector2
    velocity_m_s: Vector2
    down_m: float = 0.0
    down_m_s: float = 0.0


class Odometry(msgspec.Struct, frozen=True, gc=False):
    """Position (north, east), velocity (forward, right) and attitude in one message."""

    boot_s: float
    position_m: Vector2
    body_velocity_m_s: Vector2
    attitude: Quaternion
    yaw_rate_rad_s: float
    resets: int
    """How many times the estimator has set its position anew, modulo 256."""
    down_m: float = 0.0
    body_down_m_s: float = 0.0


class EstimatorStatus(msgspec.Struct, frozen=True, gc=False):
    """ESTIMATOR_STATUS or ArduPilot's EKF_STATUS_REPORT: both mean the same by the flags that matter here."""

    flags: int
    ratio: float
    """Greatest innovation test ratio of horizontal velocity and position; above 1 they are rejected."""


class GpsFix(msgspec.Struct, frozen=True, gc=False):
    """GPS_RAW_INT: GPS_FIX_TYPE, and the time stamp that moves on while fixes come."""

    kind: int
    stamp_us: int


class Landed(msgspec.Struct, frozen=True, gc=False):
    """MAV_LANDED_STATE of EXTENDED_SYS_STATE."""

    state: int


class TimeSync(msgspec.Struct, frozen=True, gc=False):
    """Clocks in nanoseconds: ``remote`` is zero in a request and the answerer's in an answer."""

    remote_ns: int
    asker_ns: int


class Parameter(msgspec.Struct, frozen=True, gc=False):
    """One parameter of the autopilot."""

    name: str
    value: float
    real: bool = True
    """False for an integer type: ArduPilot gives its value, PX4 its bytes in the float's place."""


class StatusText(msgspec.Struct, frozen=True, gc=False):
    """A line meant for people, such as the reason why arming was refused; severity 0 is the gravest."""

    severity: int
    text: str


class CommandResult(msgspec.Struct, frozen=True, gc=False):
    """MAV_RESULT of a command: it explains, but confirms nothing."""

    command: int
    result: int


class MessageInterval(msgspec.Struct, frozen=True, gc=False):
    """How often a message is sent: -1 disabled, 0 not available."""

    message: int
    interval_us: int


Content = (
    Heartbeat
    | Attitude
    | LocalPosition
    | Odometry
    | EstimatorStatus
    | GpsFix
    | Landed
    | TimeSync
    | Parameter
    | StatusText
    | CommandResult
    | MessageInterval
)


class Received(msgspec.Struct, frozen=True, gc=False):
    """A frame that passed every check."""

    system_id: int
    component_id: int
    content: Content


class Target(msgspec.Struct, frozen=True, gc=False):
    """A setpoint for SET_POSITION_TARGET_LOCAL_NED; the mask says which fields count."""

    frame: int
    type_mask: int
    velocity_m_s: Vector3 = (0.0, 0.0, 0.0)
    yaw_rate_rad_s: float = 0.0


class Command(msgspec.Struct, frozen=True, gc=False):
    """A COMMAND_LONG."""

    command: int
    parameters: tuple[float, ...] = ()


class ParameterRequest(msgspec.Struct, frozen=True, gc=False):
    """Asks for one parameter by name."""

    name: str


class Beat(msgspec.Struct, frozen=True, gc=False):
    """Our own heartbeat, as an onboard controller."""


Outgoing = Target | Command | ParameterRequest | TimeSync | Beat
