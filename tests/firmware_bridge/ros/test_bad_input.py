"""What goes wrong in other people's ROS: each ends in its condition, with one line and the stop sequence."""

import contextlib
import math
import os
import signal
import time
from urllib.parse import urlsplit

import pytest
from ros_peers import NAMESPACE, SPEED_M_S, Ros, domain, drive, master, needs_ros1, needs_ros2, stopped
from waiting import until

from edge_runtime.errors import BridgeError
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.wire import Phase

pytestmark = pytest.mark.integration


@pytest.fixture
def ros1(monkeypatch):
    with master(monkeypatch) as process:
        ros = Ros(1, "rospy")
        ros.master = process
        yield ros


@pytest.fixture
def ros2(monkeypatch):
    domain(monkeypatch)
    return Ros(2, "kilted")


@pytest.fixture(params=[pytest.param("ros1", marks=needs_ros1), pytest.param("ros2", marks=needs_ros2)])
def ros(request):
    return request.getfixturevalue(request.param)


@pytest.fixture
def patient(ros, tmp_path):
    """The profile, for a machine that is busy: only what the test does makes odometry stale."""
    return ros.profile_with(tmp_path)


@contextlib.contextmanager
def driving(ros, robot, profile):
    """A guard whose robot drives."""
    with GuardedBridge(ros.spec(profile=profile)) as bridge:
        drive(bridge, lambda: SPEED_M_S in robot.forward())
        yield bridge


def refused(ros, **changes):
    """The one line with which the guard does not start."""
    with pytest.raises(BridgeError) as caught, GuardedBridge(ros.spec(**changes)):
        pass
    assert "\n" not in str(caught.value)
    return str(caught.value)


def ends_with_zeros(robot):
    robot.wait(lambda: robot.forward()[-3:] == [0.0, 0.0, 0.0])
    return True


def test_odometry_that_is_not_finite_stops_the_robot(ros, patient):
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("set", "y", math.nan)
        assert "odometry is not finite" in stopped(bridge)
        assert ends_with_zeros(robot)


def test_odometry_that_jumps_stops_the_robot(ros, patient):
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("set", "y", 30.0)
        assert "odometry jumped by 30" in stopped(bridge)
        assert ends_with_zeros(robot)


def test_another_robots_odometry_stops_the_robot(ros, patient):
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("set", "frame", "a200_0007/base_link")
        assert "odometry is of 'a200_0007/base_link' now, and was of 'base_link'" in stopped(bridge)
        assert ends_with_zeros(robot)


def test_odometry_that_ends_stops_the_robot(ros, tmp_path):
    profile = ros.profile_with(tmp_path, stale_s=1.0)
    with ros.peer() as robot, driving(ros, robot, profile) as bridge:
        robot.tell("set", "odometry", False)
        assert "odometry is 1." in stopped(bridge)
        assert ends_with_zeros(robot)


def test_odometry_that_comes_back_lets_it_drive_on(ros, tmp_path):
    profile = ros.profile_with(tmp_path, stale_s=1.0, recoveries=3, enable_timeout_s=10.0)
    with ros.peer() as robot, driving(ros, robot, profile) as bridge:
        robot.tell("set", "odometry", False)
        drive(bridge, lambda: bridge.phase is Phase.RECOVERING, sequence=10_000)
        robot.tell("set", "odometry", True)
        drive(bridge, lambda: bridge.phase is Phase.DRIVING and bridge.counts.recoveries, sequence=20_000)


def test_clocks_a_minute_apart_are_told_and_do_not_matter(ros, patient):
    with ros.peer() as robot:
        robot.tell("set", "late_s", 60.0)
        with driving(ros, robot, patient) as bridge:
            drive(bridge, lambda: bridge.complaints, sequence=10_000)
            assert bridge.complaints == ("the robot's clock is 60 s behind ours: commands carry its time",)
            stamps = [heard["stamp"] for heard in robot.commands]
            if ros.message == "TwistStamped":
                assert all(abs(time.time() - 60.0 - stamp) < 30.0 for stamp in stamps)


def test_a_clock_that_is_set_back_stops_the_robot(ros, patient):
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("set", "late_s", 60.0)
        assert "odometry comes 60" in stopped(bridge)
        assert ends_with_zeros(robot)


def test_a_simulators_time_is_taken_and_its_reset_stops_the_robot(ros, patient):
    with ros.peer(parameters={"/use_sim_time": True}) as robot:
        robot.tell("set", "late_s", time.time() - 100.0)
        with driving(ros, robot, patient) as bridge:
            if ros.message == "TwistStamped":
                assert all(90.0 < heard["stamp"] < 400.0 for heard in robot.commands)
            robot.tell("set", "late_s", time.time())
            assert "odometry comes " in stopped(bridge)
            assert ends_with_zeros(robot)


def test_a_rival_that_commands_zero_has_the_robot(ros, patient):
    topic = ros.robot()["command"]
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        nothing = dict.fromkeys(("command", "odometry", "stop", "parameter"))
        with ros.peer(**nothing, node="rival") as other:
            other.tell("rival", topic)
            assert f" publishes on {topic} too" in stopped(bridge)


def test_a_rival_that_is_there_already_keeps_it(ros):
    topic = ros.robot()["command"]
    with ros.peer() as robot:
        robot.tell("rival", topic)
        assert f"publishes on {topic} too: end it" in refused(ros)


def test_an_emergency_stop_pressed_before_the_start_is_told(ros):
    with ros.peer(pressed=True) as robot:
        assert "the emergency stop is pressed" in refused(ros)
    assert robot.commands == []


@needs_ros2
def test_one_that_was_told_once_before_the_start_is_told_too(ros2, tmp_path):
    with ros2.peer(pressed=True, kept=True) as robot:
        assert "the emergency stop is pressed" in refused(ros2, profile=ros2.profile_with(tmp_path))
    assert robot.commands == []


def test_one_pressed_under_way_has_the_robot(ros, patient):
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("publish_stop", True)
        assert "the emergency stop is pressed" in stopped(bridge)


@needs_ros2
def test_one_that_falls_silent_under_way_stops_the_robot(ros2, tmp_path):
    profile = ros2.profile_with(tmp_path, emergency_stop_silent_s=5.0)
    with ros2.peer() as robot, driving(ros2, robot, profile) as bridge:
        robot.tell("publish_stop", None)
        assert "the emergency stop has been silent for 5." in stopped(bridge)
        assert ends_with_zeros(robot)


def test_an_operator_has_the_robot(ros, patient):
    topic = f"{'' if ros.kind == 1 else NAMESPACE}/joy_teleop/cmd_vel"
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("rival", topic)
        assert f"an operator commands the robot on {topic}" in stopped(bridge)


def test_a_subscriber_that_vanishes_is_a_lost_robot(ros, patient):
    with ros.peer() as robot, driving(ros, robot, patient) as bridge:
        robot.tell("vanish")
        assert f"nobody listens on {ros.robot()['command']}" in stopped(bridge)


def test_another_type_is_refused(ros, tmp_path):
    other = {"Twist": "TwistStamped", "TwistStamped": "Twist"}[ros.message]
    with ros.peer():
        line = refused(ros, profile=ros.profile_with(tmp_path, message=other))
    assert f"carries geometry_msgs/{ros.message} here, --ros-profile says geometry_msgs/{other}" in line


def test_another_namespace_is_refused(ros):
    topic = ros.robot()["command"]
    with ros.peer():
        line = refused(ros, namespace="/a200_0001")
    assert "nobody listens on /a200_0001/cmd_vel" in line
    assert f"but there are {topic}: check --ros-namespace" in line


def test_two_guards_of_one_robot_are_refused(ros, patient):
    def refusal():
        # A busy machine may not have discovered the first one yet; that one then yields to the second.
        try:
            with GuardedBridge(ros.spec()):
                return ""
        except BridgeError as error:
            return str(error)

    with ros.peer() as robot, driving(ros, robot, patient):
        assert "cfpg_edge_0 is there already" in until(refusal)


@pytest.mark.parametrize(
    ("timeout", "said"), [(2.0, "command timeout is 2 s"), (None, "unknown"), (0.0, "off")]
)
def test_a_timeout_that_does_not_stop_the_robot_is_refused(ros, timeout, said):
    robot = {"timeout": timeout} if timeout is not None else {"parameter": None}
    with ros.peer(**robot):
        assert said in refused(ros)


def test_a_whole_number_is_a_timeout_too(ros):
    with ros.peer(timeout=1), GuardedBridge(ros.spec()) as bridge:
        until(lambda: bridge.read() or bridge.reaction.firmware_timeout_s)
        assert bridge.reaction.firmware_timeout_s == 1.0


def test_text_is_none(ros):
    with ros.peer(timeout="soon"):
        assert "unknown" in refused(ros)


def test_a_killed_guard_leaves_the_robot_to_its_controllers_timeout(ros, patient):
    with ros.peer() as robot:
        with contextlib.suppress(BridgeError), driving(ros, robot, patient) as bridge:
            os.kill(bridge.guard_pid, signal.SIGKILL)
            robot.wait(lambda: robot.timeouts)
        assert robot.timeouts[0]["speed"] == SPEED_M_S
        assert robot.timeouts[0]["timed_out"] >= ros.robot()["timeout"]


def test_a_killed_guard_can_be_followed_by_another(ros1, tmp_path):
    profile = ros1.profile_with(tmp_path)
    with ros1.peer() as robot:
        with contextlib.suppress(BridgeError), driving(ros1, robot, profile) as bridge:
            os.kill(bridge.guard_pid, signal.SIGKILL)
            robot.wait(lambda: robot.timeouts)
        robot.commands.clear()
        with driving(ros1, robot, profile):
            pass


@needs_ros1
def test_without_a_master_nothing_starts(monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")
    line = refused(Ros(1, "rospy"))
    assert "no answer from the ROS master http://127.0.0.1:1" in line
    assert "start roscore, or set ROS_MASTER_URI" in line


@needs_ros1
def test_another_master_does_not_know_the_robot(ros1, monkeypatch):
    with ros1.peer(), master(monkeypatch):
        line = refused(ros1)
    assert "nobody listens on /cmd_vel, and nobody else is there (ROS master http://" in line


@needs_ros2
def test_another_domain_does_not_know_the_robot(ros2, monkeypatch):
    with ros2.peer():
        monkeypatch.setenv("ROS_DOMAIN_ID", "101")
        line = refused(ros2)
    assert "and nobody else is there (domain 101, rmw_fastrtps_cpp)" in line


@needs_ros1
def test_a_master_that_dies_is_a_lost_robot_and_stays_so_when_it_returns(ros1, monkeypatch, tmp_path):
    with ros1.peer() as robot, driving(ros1, robot, ros1.profile_with(tmp_path)) as bridge:
        ros1.master.kill()
        line = stopped(bridge)
        assert "no answer from the ROS master" in line
        assert ends_with_zeros(robot)
        place = urlsplit(os.environ["ROS_MASTER_URI"])
        ros1.master.wait()
        with master(monkeypatch, (place.hostname, place.port)):
            # It has forgotten everybody: who wants to be known must register again.
            assert "nobody listens on /cmd_vel, and nobody else is there" in refused(ros1)
            assert bridge.phase is Phase.STOPPED
            with ros1.peer() as again, driving(ros1, again, ros1.profile_with(tmp_path)):
                pass


@needs_ros1
def test_a_node_that_takes_our_name_ends_us(ros1, tmp_path):
    nothing = dict.fromkeys(("command", "odometry", "stop", "parameter"))
    profile = ros1.profile_with(tmp_path)
    with (
        ros1.peer() as robot,
        driving(ros1, robot, profile) as bridge,
        ros1.peer(**nothing, node="cfpg_edge_0"),
    ):
        assert "another node took the name /cfpg_edge_0" in stopped(bridge)


@needs_ros2
def test_a_library_that_does_not_load_names_setup_bash(monkeypatch):
    domain(monkeypatch)
    monkeypatch.delenv("LD_LIBRARY_PATH")
    assert "source your ROS's setup.bash" in refused(Ros(2, "kilted"))
