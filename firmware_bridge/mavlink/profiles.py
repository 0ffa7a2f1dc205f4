"""What differs between autopilots: modes, setpoint masks, types, and how long they drive on by themselves.

Sources: ArduPilot "Rover commands in guided mode" and "Copter commands in guided mode"; its sources, 4.6 and
4.7: Rover/mode_guided.cpp (three seconds in every submode, and no parameter), ArduCopter/mode_guided.cpp
(GUID_TIMEOUT), GCS_MAVLink/GCS_Common.cpp (cap_message_interval: 80 % of SCHED_LOOP_RATE); PX4 "Offboard
mode"; the MAVLink ``common`` message set (POSITION_TARGET_TYPEMASK: a set bit means a field that is ignored).
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

ROVERS = {10: "rover", 11: "boat"}
"""MAV_TYPE of what stays on the ground, or on water."""
COPTERS = {
    2: "quadrotor",
    3: "coaxial helicopter",
    4: "helicopter",
    13: "hexarotor",
    14: "octorotor",
    15: "tricopter",
    29: "dodecarotor",
    35: "decarotor",
}
"""MAV_TYPE of what flies and can hover."""
AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
"""MAV_AUTOPILOT."""


class SetpointKind(enum.Enum):
    """What the autopilot follows."""

    FORWARD_AND_YAW_RATE = "forward speed and yaw rate"
    """Wheels that do not slip: given a lateral velocity, the rover turns and drives hypot(vx, vy)."""
    VELOCITY = "velocity"
    """Not accelerations, which Copter takes too: under those it keeps no speed limit."""


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
    autopilot: int
    """MAV_AUTOPILOT."""
    kinds: frozenset[int]
    """MAV_TYPE of the vehicles that its modes belong to."""
    motion: SetpointKind
    command_mode: Mode
    stop_mode: Mode
    timeout_parameter: str
    """Seconds without setpoints after which the firmware stops by itself."""
    estimator_message: int
    """Number of the message that tells how sound the position is."""
    fixed_timeout_s: float | None = None
    """What counts where the firmware has no such parameter."""
    loop_rate_parameter: str = ""
    """Its scheduler's rate in Hz: messages are sent at 80 % of it at most."""
    prestream_s: float = 0.0
    """How long setpoints must already be streaming when the mode is asked for."""


PROFILES = {
    profile.name: profile
    for profile in (
        Profile(
            name="ardupilot_rover",
            autopilot=3,
            kinds=frozenset(ROVERS),
            motion=SetpointKind.FORWARD_AND_YAW_RATE,
            command_mode=Mode("GUIDED", 15, 0, 15),
            stop_mode=Mode("HOLD", 4, 0, 4),
            timeout_parameter="GUID_TIMEOUT",
            fixed_timeout_s=3.0,
            estimator_message=193,
            loop_rate_parameter="SCHED_LOOP_RATE",
        ),
        Profile(
            name="ardupilot_copter",
            autopilot=3,
            kinds=frozenset(COPTERS),
            motion=SetpointKind.VELOCITY,
            command_mode=Mode("GUIDED", 4, 0, 4),
            # Not LOITER: it descends when the sticks of an absent pilot rest at zero throttle.
            stop_mode=Mode("BRAKE", 17, 0, 17),
            timeout_parameter="GUID_TIMEOUT",
            estimator_message=193,
            loop_rate_parameter="SCHED_LOOP_RATE",
        ),
        Profile(
            name="px4",
            autopilot=12,
            kinds=frozenset({**ROVERS, **COPTERS}),
            motion=SetpointKind.VELOCITY,
            command_mode=Mode("OFFBOARD", 6, 0, 6 << 16),
            stop_mode=Mode("HOLD", 4, 3, 4 << 16 | 3 << 24),
            timeout_parameter="COM_OF_LOSS_T",
            estimator_message=230,
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


def misfit(profile: Profile, autopilot: int, kind: int) -> str:
    """Say what a vehicle is, where the profile is for another; empty where it fits."""
    if autopilot == profile.autopilot and kind in profile.kinds:
        return ""
    vehicle = {**ROVERS, **COPTERS}.get(kind, f"vehicle of MAV_TYPE {kind}")
    maker = AUTOPILOTS.get(autopilot, f"MAV_AUTOPILOT {autopilot}")
    fitting = [p.name for p in PROFILES.values() if p.autopilot == autopilot and kind in p.kinds]
    remedy = f"pass --mavlink-autopilot {fitting[0]}" if fitting else f"choose among {', '.join(PROFILES)}"
    return f"a {vehicle} under {maker} is not what --mavlink-autopilot {profile.name} is for; {remedy}"
