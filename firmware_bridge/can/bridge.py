"""``edge-run --bridge can``: its flags, and the Bridge behind the guard."""

import argparse
from pathlib import Path

import msgspec

from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.can.bus import SIMULATED, SIMULATED_KIND, bus_arguments
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.feedback import PlanarPose
from firmware_bridge.can.link import CanOptions
from firmware_bridge.can.profile import Profile, load_profile, profile_path
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.spec import (
    GuardFlags,
    GuardSpec,
    add_guard_arguments,
    flags_from,
    guard_spec,
    setpoint_limits,
    speed_limit_m_s,
)
from firmware_bridge.kinematics.fit import check_base

CONFIRMING = "look, then set it to true in your copy of the profile"


class CanFlags(msgspec.Struct, frozen=True):
    """The flags, as parsed."""

    bus: str
    profile: str
    guard: GuardFlags
    max_speed_m_s: float | None = None
    pose: PlanarPose = PlanarPose()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this bridge, the guard's included; ``options_from`` reads them back."""
    group = parser.add_argument_group("CAN bridge")
    group.add_argument(
        "--bus",
        required=True,
        help="can0, interface:channel?key=value for python-can, a serial port, or sim: nothing plugged in",
    )
    group.add_argument("--profile", required=True, help="name of a shipped profile, or a .toml file")
    group.add_argument("--max-speed", type=float, metavar="M_S", help="limit below the profile's")
    group.add_argument(
        "--pose",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "HEADING"),
        help="where the robot starts in the team's frame (m, m, rad)",
    )
    add_guard_arguments(parser)


def options_from(arguments: argparse.Namespace) -> CanFlags:
    """Return this bridge's flags that were parsed."""
    return CanFlags(
        arguments.bus,
        arguments.profile,
        flags_from(arguments),
        arguments.max_speed,
        PlanarPose(*arguments.pose),
    )


def open_bridge(mission: Mission, options: CanFlags) -> GuardedBridge:
    """Return the mission's bridge, ready to be entered.

    Raises:
        ConfigError: as `make_spec`, and if the profile asks for what nobody has confirmed.
    """
    path = profile_path(options.profile)
    for what, confirmed in load_profile(path).confirm.items():
        if not confirmed:
            raise ConfigError(f"{path}: confirm: not confirmed: {what}; {CONFIRMING}")
    return GuardedBridge(make_spec(mission.robot_id, mission.bundle.manifest, options, mission.rate_hz))


def make_spec(robot_id: int, manifest: Manifest, options: CanFlags, rate_hz: float) -> GuardSpec:
    """Check everything that can be checked without the bus and describe the guard.

    Raises:
        ConfigError: if profile, DBC, limits, rates or the bus's address do not fit.
    """
    path = profile_path(options.profile)
    profile = load_profile(path)
    CanCodec(profile, path)
    if profile.transport == "can":
        bus_arguments(options.bus)
    if options.bus == SIMULATED and (Path(profile.dbc).name, profile.base.kind) != SIMULATED_KIND:
        raise ConfigError(f"--bus {SIMULATED}: its chassis is one of --profile agilex_v2 or a copy of it")
    _check_rate(profile, rate_hz)
    check_base(manifest.motion, profile.base, str(path))
    link = CanOptions(options.bus, str(path), options.pose, manifest.motion.turns)
    speed = speed_limit_m_s(options.max_speed_m_s, profile.limits.speed_m_s, options.profile)
    limits = setpoint_limits(manifest, speed, profile.base.max_yaw_rad_s)
    return guard_spec("can", robot_id, limits, link, rate_hz, options.guard, profile.stop.deceleration_m_s2)


def _check_rate(profile: Profile, rate_hz: float) -> None:
    timeout_s = profile.watchdog.timeout_s if profile.watchdog else profile.firmware_timeout_s
    if timeout_s and 1.0 / rate_hz >= timeout_s:
        raise ConfigError(
            f"a control rate of {rate_hz:g} Hz is too slow: "
            f"this firmware stops after {timeout_s:g} s without a command"
        )
