"""What the doctor says of a ROS robot: of one in memory, and of genuine nodes."""

import subprocess
import sys

import pytest
from msgspec.structs import replace
from ros_fakes import COMMAND, ODOMETRY, PROFILE, STOP, WHOLE, FakeClient
from ros_peers import NAMESPACE, Ros, domain, drive, master, needs_ros1, needs_ros2
from waiting import until

import firmware_bridge.ros.diagnostics as diagnostics
from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Verdict
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.spec import GuardFlags
from firmware_bridge.ros.bridge import RosFlags
from firmware_bridge.ros.client import Graph, Pressed, Sight
from firmware_bridge.ros.inbox import Inbox
from firmware_bridge.ros.odometry import Odometer, Odometry, Origin
from firmware_bridge.ros.profile import load_profile, profile_path

FLAGS = RosFlags(2, "clearpath_jazzy", GuardFlags(arm=True), namespace=NAMESPACE)


@pytest.fixture
def mission():
    fleet = load_fleet(DEFAULT_FLEET)
    bundle = packaged_bundle("navigation")
    return Mission(0, fleet, bundle, fleet.objective_set, 20.0)


@pytest.fixture
def clock(monkeypatch):
    """Time passes only while somebody waits."""
    now = [50.0]

    def wait(_r, _w, _x, seconds):
        now[0] += min(seconds, 0.1)

    monkeypatch.setattr(diagnostics.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(diagnostics.time, "sleep", lambda seconds: wait((), (), (), seconds))
    monkeypatch.setattr(diagnostics.select, "select", wait)
    return now


@pytest.fixture
def examined(mission, monkeypatch, clock):
    """Findings by name, of a robot whose client and profile the test changes."""

    def examine(change=lambda _: None, profile=PROFILE, flags=FLAGS, **odometry):
        inbox = Inbox()
        client = FakeClient(inbox)
        fields = {"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0, "forward_m_s": 0.0, "lateral_m_s": 0.0,
                  "yaw_rad_s": 0.0, "stamp_s": 0.0, "arrival_s": clock[0], "frame": "base_link"}  # fmt: skip
        client.arriving = [Odometry(**{**fields, **odometry}), Sight(0), Pressed(False)]
        change(client)
        odometer = Odometer(0, profile, NAMESPACE, Origin())
        monkeypatch.setattr(diagnostics, "make_parts", lambda _: (profile, client, inbox, odometer))
        found = {one.name: one for one in diagnostics.examine_link(mission, flags)}
        assert client.log[-1] == "close"
        assert "advertise" not in client.log
        return found

    return examine


def test_a_whole_robot(examined):
    found = examined()
    assert {one.verdict for name, one in found.items() if name != "stopping"} == {Verdict.OK}
    assert found["ROS"].detail == "domain 7, as /a200_0000/cfpg_edge_0"
    assert f"{ODOMETRY} (nav_msgs/Odometry)" in found["topics"].detail
    assert found["firmware timeout"].detail.startswith("0.5 s, as /a200_0000/platform_velocity_controller")


def test_a_ros_that_is_not_there_ends_the_checks(examined):
    def change(client):
        def connect():
            raise ConfigError("no ROS")

        client.connect = connect

    found = examined(change)
    assert list(found) == ["ROS"]
    assert found["ROS"].detail == "no ROS"


def graph(graph):
    return lambda client: setattr(client, "graphs", [graph])


@pytest.mark.parametrize(
    ("change", "name", "verdict", "detail"),
    [
        (graph(Graph()), "topics", Verdict.FAIL, "nobody listens on"),
        (graph(Graph(WHOLE, (FakeClient.name,))), "topics", Verdict.FAIL, "is there already"),
        (lambda c: setattr(c, "misfits", ("one", "two")), "quality of service", Verdict.FAIL, "one; two"),
        (lambda c: c.arriving.pop(0), "odometry", Verdict.FAIL, "no odometry yet"),
        (lambda c: c.arriving.append(Pressed(True)), "emergency stop", Verdict.FAIL, f"pressed ({STOP})"),
        (lambda c: c.arriving.pop(), "emergency stop", Verdict.WARN, "nobody has said anything"),
        (lambda c: setattr(c, "timeout", None), "firmware timeout", Verdict.FAIL, "unknown"),
        (lambda c: setattr(c, "timeout", 2.0), "firmware timeout", Verdict.FAIL, "is 2 s"),
    ],
)
def test_each_thing_that_may_be_wrong(examined, change, name, verdict, detail):
    found = examined(change)[name]
    assert found.verdict is verdict
    assert detail in found.detail


def test_a_rival_that_is_discovered_after_the_robot_is_named(examined):
    rival = Graph({**WHOLE, COMMAND: replace(WHOLE[COMMAND], publishers=("/joystick",))})

    def change(client):
        client.settling_s, client.graphs = 2.0, [*[Graph(WHOLE)] * 5, rival]

    found = examined(change)["topics"]
    assert (found.verdict, "/joystick publishes on" in found.detail) == (Verdict.FAIL, True)


def test_a_clock_apart_is_a_warning(examined):
    found = examined(stamp_s=1000.0)["odometry"]
    assert found.verdict is Verdict.WARN
    assert "behind ours" in found.detail


@pytest.mark.parametrize(
    ("timeout", "verdict", "source"),
    [
        ("", Verdict.FAIL, "nobody has told it"),
        ("firmware_timeout_s = 0.5\n", Verdict.OK, "says the profile"),
    ],
)
def test_a_profile_without_parameter_and_stop(examined, tmp_path, timeout, verdict, source):
    path = tmp_path / "limo.toml"
    path.write_text(timeout + profile_path("limo_ros2").read_text())
    found = examined(profile=load_profile(path).under(""))
    assert found["emergency stop"].verdict is Verdict.WARN
    assert found["firmware timeout"].verdict is verdict
    assert source in found["firmware timeout"].detail


def test_flags_that_do_not_fit_are_refused_at_once(mission):
    with pytest.raises(ConfigError, match="speaks ROS 1"):
        diagnostics.examine_link(mission, RosFlags(2, "husky_noetic"))


def asked(ros, tmp_path, program="edge_runtime.doctor", *more):
    """Run a program of ours with the flags of this robot."""
    options = ros.options()
    (tmp_path / "one.toml").write_text("[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [3.0, 1.0]\n")
    namespace = ("--ros-namespace", options.namespace) if options.namespace else ()
    command = [
        *(sys.executable, "-m", program, "--robot-id", "0", "--rate", "50", "--fleet", tmp_path / "one.toml"),
        *("--bridge", f"ros{ros.kind}", "--ros-profile", ros.profile, *namespace),
        *("--ros-path", options.python_path[0], "--arm", *more),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(params=[pytest.param(1, marks=needs_ros1), pytest.param(2, marks=needs_ros2)])
def ros(request, monkeypatch):
    if request.param == 1:
        with master(monkeypatch):
            yield Ros(1, "rospy")
    else:
        domain(monkeypatch)
        yield Ros(2, "kilted")


@pytest.mark.integration
def test_the_doctor_looks_at_a_genuine_robot_and_at_one_that_is_driven(ros, tmp_path):
    with ros.peer() as robot:
        told = asked(ros, tmp_path)
        assert told.returncode == 0, told.stdout + told.stderr
        assert "emergency stop    released" in told.stdout
        with GuardedBridge(ros.spec(profile=ros.profile_with(tmp_path))) as bridge:
            drive(bridge, lambda: 0.5 in robot.forward())
            told = asked(ros, tmp_path)
            assert told.returncode == 1
            assert "cfpg_edge_0 is there already" in told.stdout
            drive(bridge, lambda: True, sequence=10_000)


@needs_ros2
@pytest.mark.integration
def test_it_names_a_quality_of_service_that_keeps_commands_away(monkeypatch, tmp_path):
    domain(monkeypatch)
    ros = Ros(2, "kilted")
    with ros.peer(transient=True):
        told = asked(ros, tmp_path)
    assert told.returncode == 1
    assert f"fail  quality of service {NAMESPACE}/cmd_vel" in told.stdout


@pytest.mark.integration
def test_edge_run_drives_a_genuine_robot_and_stops_it(ros, tmp_path):
    with ros.peer() as robot:
        flags = ("--guard-deadline", "1", "--duration", "2")

        def driven():
            """A run whose guard did not stop the robot because the machine was busy."""
            told = asked(ros, tmp_path, "edge_runtime.run", *flags)
            return None if "no fresh command" in told.stderr else told

        told = until(driven)
        assert told.returncode == 0, told.stdout + told.stderr
        robot.wait(lambda: robot.forward()[-3:] == [0.0, 0.0, 0.0])
    assert len(set(robot.forward())) > 2
