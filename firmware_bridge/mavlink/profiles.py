"""What differs between autopilots: modes, setpoint masks, the parameter that holds their own timeout.

Sources: ArduPilot "Rover commands in guided mode" and "Copter commands in guided mode", PX4 "Offboard mode",
the MAVLink ``common`` message set (POSITION_TARGET_TYPEMASK: a set bit means that the field is ignored).
"""

import enum

import msgspec

from edge_runtime.errors import ConfigError

LOCAL_NED = 1
BODY_NED = 8
VELOCITY_ONLY = 0xDC7
"""Position, acceleration, yaw and yaw rate ignored."""
VELOCITY_AND_YAW_RATE = 0x5C7
"""Position, acceleration and yaw ignored."""
ACCELERATION_ONLY = 0xC3F
"""Position, velocity, yaw and yaw rate ignored."""


class SetpointKind(enum.Enum):
    """What the autopilot follows."""

    FORWARD_AND_YAW_RATE = "forward speed and yaw rate"
    """Wheels that do not slip: given a lateral velocity, the rover turns and drives hypot(vx, vy)."""
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"


class Mode(msgspec.Struct, frozen=True):
    """A mode as DO_SET_MODE asks for it and as HEARTBEAT reports it."""

    name: str
    main: int
    sub: int
    reported: int
    """HEARTBEAT.custom_mode."""


class Profile(msgspec.Struct, frozen=True):
    """One kind of autopilot."""

    name: str
    motion: SetpointKind
    command_mode: Mode
    stop_mode: Mode
    timeout_parameter: str
    """Seconds without setpoints after which the firmware stops by itself."""
    prestream_s: float = 0.0
    """How long setpoints must already be streaming when the mode is asked for."""


PROFILES = {
    profile.name: profile
    for profile in (
        Profile(
            name="ardupilot_rover",
            motion=SetpointKind.FORWARD_AND_YAW_RATE,
            command_mode=Mode("GUIDED", 15, 0, 15),
            stop_mode=Mode("HOLD", 4, 0, 4),
            timeout_parameter="GUID_TIMEOUT",
        ),
        Profile(
            name="ardupilot_copter",
            motion=SetpointKind.ACCELERATION,
            command_mode=Mode("GUIDED", 4, 0, 4),
            # Not LOITER: it descends when the sticks of an absent pilot rest at zero throttle.
            stop_mode=Mode("BRAKE", 17, 0, 17),
            timeout_parameter="GUID_TIMEOUT",
        ),
        Profile(
            name="px4",
            motion=SetpointKind.VELOCITY,
            command_mode=Mode("OFFBOARD", 6, 0, 6 << 16),
            stop_mode=Mode("HOLD", 4, 3, 4 << 16 | 3 << 24),
            timeout_parameter="COM_OF_LOSS_T",
            prestream_s=1.2,
        ),
    )
}


def find_profile(name: str) -> Profile:
    """Return the profile of that name.

    Raises:
        ConfigError: if there is none, with the names that exist.
    """
    try:
        return PROFILES[name]
    except KeyError:
        raise ConfigError(f"--mavlink-autopilot {name!r} is unknown; choose {', '.join(PROFILES)}") from None
