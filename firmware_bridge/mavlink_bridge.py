"""``--bridge mavlink``: the flags, and the bridge that they describe."""

import argparse
import math
from pathlib import Path

import msgspec

from edge_runtime.dynamics import Dynamics
from edge_runtime.errors import ConfigError
from firmware_bridge.guard_link import Limits
from firmware_bridge.guard_spec import GuardSpec, deadline_s, flags_from
from firmware_bridge.guarded_bridge import GuardedBridge
from firmware_bridge.mavlink_link import MavlinkOptions
from firmware_bridge.mavlink_profiles import PROFILES, find_profile
from firmware_bridge.mavlink_signing import read_key
from firmware_bridge.mavlink_transport import FORMS, parse_address


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this bridge's flags; the guard's own come from ``guard_spec.add_guard_arguments``."""
    group = parser.add_argument_group("mavlink (ArduPilot, PX4)")
    add = group.add_argument
    add("--mavlink", metavar="ADDRESS", default="udpin:127.0.0.1:14550", help=FORMS)
    add("--mavlink-autopilot", metavar="NAME", default="ardupilot_rover", help=", ".join(PROFILES))
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


def open_bridge(
    arguments: argparse.Namespace, robot_id: int, period_s: float, limits: Limits, dynamics: Dynamics
) -> GuardedBridge:
    """Return the bridge that the flags describe; entering it starts the guard.

    Args:
        arguments: parsed flags of ``add_arguments`` and ``add_guard_arguments``.
        robot_id: which robot of the team this is.
        period_s: control period.
        limits: what the guard lets through.
        dynamics: of the policy, with its own period.

    Raises:
        ConfigError: names the flag that does not fit.
    """
    options = _options(arguments, dynamics.at_period(period_s))
    flags = flags_from(arguments)
    spec = GuardSpec(
        link="mavlink",
        robot_id=robot_id,
        deadline_s=deadline_s(period_s, flags),
        limits=limits,
        options=msgspec.Raw(msgspec.json.encode(options)),
        arm=flags.arm,
        allow_unsafe_firmware_timeout=flags.allow_unsafe_firmware_timeout,
    )
    return GuardedBridge(spec)


def _options(arguments: argparse.Namespace, dynamics: Dynamics) -> MavlinkOptions:
    find_profile(arguments.mavlink_autopilot)
    parse_address(arguments.mavlink)
    for flag in ("mavlink_system", "mavlink_source_system"):
        number = getattr(arguments, flag)
        if not 1 <= number <= 255:
            raise ConfigError(f"--{flag.replace('_', '-')} must lie in [1, 255], got {number}")
    if not 0.0 <= arguments.mavlink_point_ahead < math.inf:
        raise ConfigError(f"--mavlink-point-ahead must be 0 or more, got {arguments.mavlink_point_ahead:g}")
    if arguments.mavlink_signing_key:
        read_key(Path(arguments.mavlink_signing_key))
    elif arguments.mavlink_require_signing:
        raise ConfigError("--mavlink-require-signing needs --mavlink-signing-key FILE")
    if not all(map(math.isfinite, arguments.mavlink_origin)):
        raise ConfigError("--mavlink-origin must be two finite numbers")
    return MavlinkOptions(
        autopilot=arguments.mavlink_autopilot,
        address=arguments.mavlink,
        dynamics=dynamics,
        point_ahead_m=arguments.mavlink_point_ahead,
        system_id=arguments.mavlink_system,
        source_system=arguments.mavlink_source_system,
        origin_m=tuple(arguments.mavlink_origin),
        signing_key=arguments.mavlink_signing_key,
    )
