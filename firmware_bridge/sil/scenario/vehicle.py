"""What the robots of a run are: a chassis on CAN, a rover on MAVLink, a Husky or LIMO behind ROS."""

from pathlib import Path
from typing import Final, Literal, NamedTuple

import msgspec

from edge_runtime.motion.models import MotionModel, Unicycle
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.ros.profile import load_profile as load_ros_profile
from firmware_bridge.ros.profile import profile_path as ros_profile_path

BridgeKind = Literal["can", "mavlink", "ros1", "ros2"]
PROFILE: Final = "agilex_v2"
OMNI_PROFILE: Final = "agilex_omni"
"""On CAN, for policies that turn their robot and move it sideways."""
AUTOPILOT: Final = "ardupilot_rover"
POINT_AHEAD_M: Final = 0.2
"""MAVLink: the point that is steered, ahead of the rover's axle."""


class RosKind(NamedTuple):
    """What a bridge to ROS meets."""

    ros: Literal[1, 2]
    library: str
    """By which Python speaks it."""
    profile: str
    timeout_s: float
    """Of the robot's controller, as its parameter has it from the maker."""


ROS: Final = {
    "ros1": RosKind(1, "rospy", "husky_noetic", 0.25),
    "ros2": RosKind(2, "rclpy", "clearpath_jazzy", 0.5),
}
LIMO_PROFILE: Final = Path(__file__).with_name("limo.toml")
"""Behind ROS 2 where the fleet's base is a LIMO."""


class Vehicle(msgspec.Struct, frozen=True):
    """One robot of a run."""

    profile: str
    """As edge-run is told it: of CAN, of ROS by its name or file, or the autopilot."""
    ahead_m: float
    """From its axle to the point that is steered; 0: the axle."""


def vehicle(bridge: BridgeKind, motion: MotionModel | None = None, wheels: str = "") -> Vehicle:
    """Return the robot that speaks a bridge; whether it can follow the policy, edge-run's own check says.

    Args:
        bridge: what it speaks.
        motion: the policy's motion model; None: one in the plane.
        wheels: the base of the plant ``mujoco``, where that moves it.
    """
    turns = motion is not None and motion.turns
    if bridge == "mavlink":
        return Vehicle(AUTOPILOT, 0.0 if turns else POINT_AHEAD_M)
    if bridge == "can":
        name = OMNI_PROFILE if turns and not isinstance(motion, Unicycle) else PROFILE
        base = load_profile(profile_path(name)).base
    else:
        limo = bridge == "ros2" and wheels == "limo"
        name = str(LIMO_PROFILE) if limo else ROS[bridge].profile
        base = load_ros_profile(ros_profile_path(name)).base
    return Vehicle(name, 0.0 if turns else base.reference_m)


def ros_folders(bridge: BridgeKind, asked: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return where a bridge's ROS keeps its Python packages: as asked, or as its profile has it."""
    return asked or load_ros_profile(ros_profile_path(ROS[bridge].profile)).python_path
