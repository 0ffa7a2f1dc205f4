"""The guard drives robots whose ROS nobody of this project wrote: every command arrives exactly once."""

import time
from types import SimpleNamespace

import msgspec
import pytest
from ros_peers import SPEED_M_S, Ros, domain, drive, master, needs_node, needs_ros1, needs_ros2
from waiting import HANG_S

from edge_runtime.errors import BridgeError
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.ros.client import Trouble
from firmware_bridge.ros.profile import load_profile, profile_path
from firmware_bridge.ros.ros2 import make_client

pytestmark = pytest.mark.integration


@pytest.fixture(
    params=[
        pytest.param((1, "rospy"), marks=needs_ros1, id="rospy"),
        pytest.param((1, "rosnodejs"), marks=[needs_ros1, needs_node], id="rosnodejs"),
        pytest.param((2, "cyclone"), marks=needs_ros2, id="cyclonedds"),
        pytest.param((2, "kilted"), marks=needs_ros2, id="rclpy-kilted"),
        pytest.param((2, "jazzy", "clearpath_humble"), marks=needs_ros2, id="rclpy-jazzy"),
    ]
)
def ros(request, monkeypatch):
    ros = Ros(*request.param)
    if ros.kind == 1:
        with master(monkeypatch):
            yield ros
    else:
        domain(monkeypatch)
        yield ros


def without_a_stop(profile):
    lines = profile_path(profile).read_text().splitlines()
    return "\n".join(line for line in lines if not line.startswith("emergency_stop"))


def test_each_command_arrives_once_and_the_stop_last(ros, request, tmp_path):
    wanted = request.config.getoption("commands")
    # Cyclone DDS has no parameters: nobody tells a timeout.
    known = ros.library != "cyclone"
    with ros.peer() as robot:
        patient = ros.spec(profile=ros.profile_with(tmp_path))
        spec = msgspec.structs.replace(patient, allow_unsafe_firmware_timeout=not known)
        with GuardedBridge(spec) as bridge:
            drive(bridge, lambda: bridge.counts.forwarded >= wanted, period_s=0.05)
            bridge.stop("enough")
            counts = bridge.counts
        robot.wait(lambda: robot.forward()[-3:] == [0.0, 0.0, 0.0])
    assert robot.forward() == [0.0, *[SPEED_M_S] * counts.forwarded, 0.0, 0.0, 0.0]
    assert bridge.reaction.firmware_timeout_s == (ros.robot()["timeout"] if known else None)


@needs_ros1
def test_a_robot_of_ros_1_may_want_stamps_and_have_no_emergency_stop(monkeypatch, tmp_path):
    with master(monkeypatch):
        ros = Ros(1, "rospy")
        ros.message = "TwistStamped"
        profile = tmp_path / "mine.toml"
        profile.write_text(without_a_stop("husky_noetic").replace('"Twist"', '"TwistStamped"'))
        with ros.peer(stop=None) as robot, GuardedBridge(ros.spec(profile=str(profile))) as bridge:
            drive(bridge, lambda: SPEED_M_S in robot.forward())
    assert abs(robot.commands[-1]["stamp"] - time.time()) < HANG_S


@needs_ros2
def test_a_robot_of_ros_2_may_have_no_emergency_stop(monkeypatch, tmp_path):
    domain(monkeypatch)
    ros = Ros(2, "kilted")
    profile = tmp_path / "mine.toml"
    profile.write_text(without_a_stop("clearpath_jazzy"))
    with ros.peer(stop=None) as robot, GuardedBridge(ros.spec(profile=str(profile))) as bridge:
        drive(bridge, lambda: SPEED_M_S in robot.forward())


@needs_ros2
def test_a_subscriber_whose_quality_of_service_differs_is_told(monkeypatch):
    domain(monkeypatch)
    ros = Ros(2, "kilted")
    with ros.peer(transient=True), pytest.raises(BridgeError, match="its type or QoS differs"):
        GuardedBridge(ros.spec()).__enter__()


def test_an_executor_that_ends_is_told():
    heard = []
    client = make_client(load_profile(profile_path("generic")).under(""), "", 0, (), heard.append)
    client._executor = SimpleNamespace(spin_once=lambda **_: 1 / 0)
    client._spin()
    assert heard == [Trouble("ROS 2 failed (domain 0): division by zero")]


@needs_ros2
def test_a_timeout_that_nobody_tells_is_refused(monkeypatch):
    domain(monkeypatch)
    ros = Ros(2, "cyclone")
    with (
        ros.peer(),
        pytest.raises(BridgeError, match="command timeout is unknown"),
        GuardedBridge(ros.spec()),
    ):
        pass
