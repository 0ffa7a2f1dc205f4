"""The guard drives robots whose ROS nobody of this project wrote: every command arrives exactly once."""

import msgspec
import pytest
from ros_peers import SPEED_M_S, Ros, domain, drive, master, needs_node, needs_ros1, needs_ros2

from edge_runtime.errors import BridgeError
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.wire import Phase

pytestmark = pytest.mark.integration


@pytest.fixture(
    params=[
        pytest.param((1, "rospy"), marks=needs_ros1, id="rospy"),
        pytest.param((1, "rosnodejs"), marks=[needs_ros1, needs_node], id="rosnodejs"),
        pytest.param((2, "cyclone"), marks=needs_ros2, id="cyclonedds"),
        pytest.param((2, "kilted"), marks=needs_ros2, id="rclpy-kilted"),
        pytest.param((2, "jazzy"), marks=needs_ros2, id="rclpy-jazzy"),
    ]
)
def ros(request, monkeypatch):
    kind, library = request.param
    if kind == 1:
        with master(monkeypatch):
            yield Ros(kind, library)
    else:
        domain(monkeypatch)
        yield Ros(kind, library)


def test_each_command_arrives_once_and_the_stop_last(ros):
    # Cyclone DDS has no parameters: nobody tells a timeout.
    known = ros.library != "cyclone"
    with ros.peer() as robot:
        spec = msgspec.structs.replace(ros.spec(), allow_unsafe_firmware_timeout=not known)
        with GuardedBridge(spec) as bridge:
            drive(bridge, lambda: bridge.phase is Phase.DRIVING and bridge.counts.forwarded >= 20)
            bridge.stop("enough")
            counts = bridge.counts
        robot.wait(lambda: robot.forward()[-3:] == [0.0, 0.0, 0.0])
    assert robot.forward() == [0.0, *[SPEED_M_S] * counts.forwarded, 0.0, 0.0, 0.0]
    assert bridge.reaction.firmware_timeout_s == (ros.robot()["timeout"] if known else None)


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
