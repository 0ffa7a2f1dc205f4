"""``edge-run --bridge mavlink``: its flags, and the Bridge behind the guard."""

import argparse
import math
from pathlib import Path

import msgspec

from edge_runtime.common.key_file import read_key
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Vector2
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.spec import (
    GuardFlags,
    GuardSpec,
    add_guard_arguments,
    flags_from,
    guard_spec,
    setpoint_limits,
)
from firmware_bridge.kinematics.fit import check_fit
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES, SetpointKind, find_profile
from firmware_bridge.mavlink.transport import FORMS, parse_address


class MavlinkFlags(msgspec.Struct, frozen=True):
    """The flags, as parsed."""

    address: str
    autopilot: str
    guard: GuardFlags = GuardFlags()
    max_speed_m_s: float = 1.0
    system_id: int = 1
    source_system: int = 255
    origin_m: Vector2 = (0.0, 0.0)
    point_ahead_m: float = 0.2
    signing_key: str = ""
    require_signing: bool = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this bridge, the guard's included; ``options_from`` reads them back."""
    group = parser.add_argument_group("MAVLink bridge (ArduPilot, PX4)")
    add = group.add_argument
    add("--mavlink", metavar="ADDRESS", required=True, help=FORMS)
    add("--mavlink-autopilot", metavar="NAME", required=True, help=", ".join(PROFILES))
    add("--max-speed", type=float, default=1.0, metavar="M_S", help="largest speed (default: 1 m/s)")
    add("--mavlink-system", type=int, default=1, metavar="ID", help="the autopilot's system id (default: 1)")
    add(
        "--mavlink-source-system",
        type=int,
        default=255,
        metavar="ID",
        help="ours; ArduPilot's ground station failsafe watches 255 (default: 255)",
    )
    add(
        "--mavlink-origin",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("EAST", "NORTH"),
        help="the autopilot's local origin in the team's frame, m (default: 0 0)",
    )
    add(
        "--mavlink-point-ahead",
        type=float,
        default=0.2,
        metavar="M",
        help="rover: the point that is steered and reported lies this far ahead of the axle (default: 0.2); "
        "0 refuses sideways velocities",
    )
    add("--mavlink-signing-key", default="", metavar="FILE", help="32 bytes, raw or hexadecimal, mode 600")
    add("--mavlink-require-signing", action="store_true", help="do not start without a signing key")
    add_guard_arguments(parser)


def options_from(arguments: argparse.Namespace) -> MavlinkFlags:
    """Return this bridge's flags that were parsed."""
    return MavlinkFlags(
        address=arguments.mavlink,
        autopilot=arguments.mavlink_autopilot,
        guard=flags_from(arguments),
        max_speed_m_s=arguments.max_speed,
        system_id=arguments.mavlink_system,
        source_system=arguments.mavlink_source_system,
        origin_m=tuple(arguments.mavlink_origin),
        point_ahead_m=arguments.mavlink_point_ahead,
        signing_key=arguments.mavlink_signing_key,
        require_signing=arguments.mavlink_require_signing,
    )


def open_bridge(mission: Mission, options: MavlinkFlags) -> GuardedBridge:
    """Return the mission's bridge, ready to be entered; raises as `make_spec`."""
    return GuardedBridge(make_spec(mission.robot_id, mission.bundle.manifest, options, mission.rate_hz))


def make_spec(robot_id: int, manifest: Manifest, options: MavlinkFlags, rate_hz: float) -> GuardSpec:
    """Check everything that can be checked without the link and describe the guard.

    Raises:
        ConfigError: names the flag that does not fit.
    """
    _check(options)
    profile = find_profile(options.autopilot)
    flies = profile.motion is SetpointKind.VELOCITY
    check_fit(manifest.motion, profile.name, sideways=flies, space=flies)
    link = MavlinkOptions(
        autopilot=options.autopilot,
        address=options.address,
        motion=manifest.motion.at_period(1.0 / rate_hz),
        point_ahead_m=options.point_ahead_m,
        system_id=options.system_id,
        source_system=options.source_system,
        origin_m=options.origin_m,
        signing_key=options.signing_key,
    )
    limits = setpoint_limits(manifest, options.max_speed_m_s)
    return guard_spec("mavlink", robot_id, limits, link, rate_hz, options.guard)


def _check(options: MavlinkFlags) -> None:
    parse_address(options.address)
    for flag, number in (
        ("--mavlink-system", options.system_id),
        ("--mavlink-source-system", options.source_system),
    ):
        if not 1 <= number <= 255:
            raise ConfigError(f"{flag} must lie in [1, 255], got {number}")
    if not 0.0 < options.max_speed_m_s < math.inf:
        raise ConfigError(f"--max-speed must be above 0 and finite, got {options.max_speed_m_s:g}")
    if not 0.0 <= options.point_ahead_m < math.inf:
        raise ConfigError(f"--mavlink-point-ahead must be 0 or more, got {options.point_ahead_m:g}")
    if not all(map(math.isfinite, options.origin_m)):
        raise ConfigError("--mavlink-origin must be two finite numbers")
    if options.signing_key:
        read_key(Path(options.signing_key))
    elif options.require_signing:
        raise ConfigError("--mavlink-require-signing needs --mavlink-signing-key FILE")
