"""``edge-run --bridge ros1`` and ``ros2``: their flags, and the Bridge behind the guard."""

import argparse
import math
from typing import Literal

import msgspec

from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.policy.manifest import Manifest
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
from firmware_bridge.ros.link import RosOptions
from firmware_bridge.ros.odometry import Origin
from firmware_bridge.ros.profile import check_namespace, load_profile, profile_path


class RosFlags(msgspec.Struct, frozen=True):
    """The flags, as parsed."""

    ros: Literal[1, 2]
    profile: str
    guard: GuardFlags = GuardFlags()
    namespace: str = ""
    max_speed_m_s: float | None = None
    origin: Origin = Origin()
    python_path: tuple[str, ...] = ()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this bridge, the guard's included; ``options_from`` reads them back."""
    group = parser.add_argument_group("ROS bridge")
    add = group.add_argument
    add("--ros-profile", required=True, metavar="NAME", help="name of a shipped profile, or a .toml file")
    add("--ros-namespace", default="", metavar="NS", help="the robot's, such as /a200_0000 (default: none)")
    add("--max-speed", type=float, metavar="M_S", help="limit below the profile's")
    add(
        "--ros-origin",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "HEADING"),
        help="the odometry's origin in the team's frame (m, m, rad; default: 0 0 0)",
    )
    add(
        "--ros-path",
        action="append",
        default=[],
        metavar="DIR",
        help="where rospy or rclpy lies, in place of the profile's folders; may be given several times",
    )
    add_guard_arguments(parser)


def options_from(arguments: argparse.Namespace) -> RosFlags:
    """Return this bridge's flags that were parsed."""
    return RosFlags(
        ros=1 if arguments.bridge == "ros1" else 2,
        profile=arguments.ros_profile,
        guard=flags_from(arguments),
        namespace=arguments.ros_namespace,
        max_speed_m_s=arguments.max_speed,
        origin=Origin(*arguments.ros_origin),
        python_path=tuple(arguments.ros_path),
    )


def open_bridge(mission: Mission, options: RosFlags) -> GuardedBridge:
    """Return the mission's bridge, ready to be entered; raises as `make_spec`."""
    return GuardedBridge(make_spec(mission.robot_id, mission.bundle.manifest, options, mission.rate_hz))


def make_spec(robot_id: int, manifest: Manifest, options: RosFlags, rate_hz: float) -> GuardSpec:
    """Check everything that can be checked without ROS and describe the guard.

    Raises:
        ConfigError: if profile, namespace, limits or rates do not fit.
    """
    path = profile_path(options.profile)
    profile = load_profile(path)
    check_namespace(options.namespace)
    if profile.ros is not None and profile.ros != options.ros:
        raise ConfigError(
            f"--ros-profile {options.profile}: speaks ROS {profile.ros}: --bridge ros{profile.ros}"
        )
    if not all(map(math.isfinite, msgspec.structs.astuple(options.origin))):
        raise ConfigError("--ros-origin must be three finite numbers")
    check_base(manifest.motion, profile.base, str(path))
    turns, namespace = manifest.motion.turns, options.namespace
    link = RosOptions(options.ros, str(path), namespace, options.origin, options.python_path, turns)
    speed = speed_limit_m_s(options.max_speed_m_s, profile.limits.speed_m_s, options.profile)
    limits = setpoint_limits(manifest, speed, profile.base.max_yaw_rad_s)
    return guard_spec(
        f"ros{options.ros}", robot_id, limits, link, rate_hz, options.guard, profile.limits.deceleration_m_s2
    )
