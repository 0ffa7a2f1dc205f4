"""What a guard is started with, and the flags that every guarded bridge shares."""

import argparse

import msgspec

from edge_runtime.common.bounds import GREATEST_YAW_RATE_RAD_S
from edge_runtime.errors import ConfigError
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.guard.link import SetpointLimits

LONGEST_DEFAULT_DEADLINE_S = 0.1
LONGEST_FIRMWARE_TIMEOUT_S = 1.0


class GuardFlags(msgspec.Struct, frozen=True):
    """The shared flags, as parsed."""

    arm: bool = False
    deadline_s: float | None = None
    allow_unsafe_firmware_timeout: bool = False


class GuardSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything the guard process needs; travels as JSON on its command line."""

    link: str
    """One of `edge_runtime.run.bridges.BRIDGES` with a ``guard_link``."""
    robot_id: int
    deadline_s: float
    """Longest time without a fresh command."""
    limits: SetpointLimits
    options: msgspec.Raw
    """JSON that only the link understands."""
    arm: bool = False
    allow_unsafe_firmware_timeout: bool = False
    deceleration_m_s2: float | None = None
    """Of the robot's stop, as its profile has it; None where no profile says."""


def add_guard_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shared flags; ``flags_from`` reads them back."""
    group = parser.add_argument_group("guard (the process that owns the bus)")
    group.add_argument("--arm", action="store_true", help="let the guard enable or arm the robot")
    group.add_argument(
        "--guard-deadline",
        type=float,
        metavar="S",
        help="stop after this long without a fresh command (default: 3 periods, at most 0.1 s)",
    )
    group.add_argument(
        "--allow-unsafe-firmware-timeout",
        action="store_true",
        help="start although the firmware's own command timeout is unknown, off or over 1 s",
    )


def flags_from(arguments: argparse.Namespace) -> GuardFlags:
    """Return the shared flags that were parsed."""
    return GuardFlags(arguments.arm, arguments.guard_deadline, arguments.allow_unsafe_firmware_timeout)


def speed_limit_m_s(asked: float | None, carried: float, profile: str) -> float:
    """The speed limit of a robot whose profile carries one: what ``--max-speed`` asks for, or that.

    Args:
        asked: by the flag, in m/s; None where it is not given.
        carried: by the profile, in m/s.
        profile: its name, for errors.

    Raises:
        ConfigError: if it asks for nothing positive, or for more than the profile's.
    """
    wanted = carried if asked is None else asked
    if not 0.0 < wanted <= carried:
        raise ConfigError(
            f"--max-speed {wanted:g}: must be positive and at most {carried:g} m/s, "
            f"the limit of profile {profile}"
        )
    return wanted


def setpoint_limits(
    manifest: Manifest, speed_m_s: float, yaw_rate_rad_s: float = GREATEST_YAW_RATE_RAD_S
) -> SetpointLimits:
    """Return what the guard lets through of a policy: its actions, and no turn where it turns no robot."""
    motion = manifest.motion
    return SetpointLimits(
        speed_m_s,
        tuple(field.low for field in manifest.action),
        tuple(field.high for field in manifest.action),
        min(yaw_rate_rad_s, GREATEST_YAW_RATE_RAD_S) if motion.turns else 0.0,
        motion.dims,
    )


def guard_spec(
    link: str,
    robot_id: int,
    limits: SetpointLimits,
    options: msgspec.Struct,
    rate_hz: float,
    flags: GuardFlags,
    deceleration_m_s2: float | None = None,
) -> GuardSpec:
    """Describe a guard by the shared flags and what its link alone understands; raises as `deadline_s`."""
    return GuardSpec(
        link=link,
        robot_id=robot_id,
        deadline_s=deadline_s(1.0 / rate_hz, flags),
        limits=limits,
        options=msgspec.Raw(msgspec.json.encode(options)),
        arm=flags.arm,
        allow_unsafe_firmware_timeout=flags.allow_unsafe_firmware_timeout,
        deceleration_m_s2=deceleration_m_s2,
    )


def deadline_s(period_s: float, flags: GuardFlags) -> float:
    """Return the longest silence that the guard tolerates at this control period.

    Raises:
        ConfigError: if the deadline is not positive, over 1 s, or not longer than the period.
    """
    deadline = flags.deadline_s
    if deadline is None:
        deadline = min(3 * period_s, LONGEST_DEFAULT_DEADLINE_S)
    if not period_s < deadline <= 1.0:
        raise ConfigError(
            f"--guard-deadline {deadline:g} s does not fit a control period of {period_s:g} s: it must be "
            "longer than the period and at most 1 s; control faster than 10 Hz or set the flag"
        )
    return deadline
