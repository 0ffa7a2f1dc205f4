"""Tracked objects and further sensors: streams of their own, from edge-pose to the robot's view."""

import contextlib
import json
import math
import threading
import time
from types import SimpleNamespace

import pytest
from fleet_processes import mission, robot
from ports import free_port
from waiting import HANG_S, until

from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.network import endpoint
from edge_runtime.config.tracked import tag_of
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState
from edge_runtime.network.stream_wire import Kind
from edge_runtime.team.membership import Alone, open_fleet
from edge_runtime.tools.pose import edge_pose as command
from edge_runtime.tools.pose.edge_pose import main as edge_pose
from edge_runtime.tools.pose.stream_host import StreamHost
from edge_runtime.tools.pose.velocity import MotionFit

KEY = b"k" * 32
TRACKED = """
[[tracked]]
name = "package"
pose = "{0}"
goal_m = [0.5, 0.7]
[[tracked]]
name = "person"
pose = "{0}"
rigid_body = 7
"""


@pytest.fixture
def place():
    return free_port()


@pytest.fixture
def path(tmp_path, place):
    """A fleet of one robot with two tracked objects and a sensor, all told from one place."""
    (tmp_path / "team.key").write_bytes(KEY)
    (tmp_path / "team.key").chmod(0o600)
    file, source = tmp_path / "fleet.toml", f"{place[0]}:{place[1]}"
    sensors = f'sensors = {{samples = "{source}"}}'
    file.write_text('[carrier]\nkey = "team.key"\n' + robot(0, sensors) + TRACKED.format(source))
    return file


def bridge_state():
    return RobotState(0, time.monotonic(), (0.0, 0.0), (0.0, 0.0))


def host_for(path, place):
    robots = {member.id: endpoint(member.address) for member in load_fleet(path).robots}
    return StreamHost(place, robots, [], [], KEY, ["package", "person"], [(0, "samples")])


def exchange(link, host, condition):
    def tick():
        host.listen(0.005)
        now = time.monotonic()
        host.publish_object("package", now, (1.0, 2.0, 0.1, 0.2, 0.5, -0.3))
        host.publish_object("person", now, (3.0, 4.0, 5.0, 0.0, 0.0, 0.0, 0.25, 0.0))
        host.publish(Kind.SENSOR, 0, now, (0.5, 0.25), "samples")
        own = link.locate(bridge_state())
        view = link.team(own)
        return view if condition(view) else None

    return until(tick)


def test_objects_and_sensors_are_seen_under_their_names(path, place):
    with open_fleet(mission(path), Alone()) as link, host_for(path, place) as host:
        assert link.team(link.locate(bridge_state())).fault == "waits for the package stream: not heard yet"
        view = exchange(link, host, lambda view: not view.fault)
    package, person = view.tracked
    assert (package.name, package.position_m, package.velocity_m_s) == ("package", (1.0, 2.0), (0.1, 0.2))
    assert (package.heading_rad, package.yaw_rate_rad_s, package.goal_m) == (0.5, -0.3, (0.5, 0.7))
    assert (person.position_m, person.velocity_m_s, person.goal_m) == ((3.0, 4.0), (0.0, 0.0), None)
    assert 0.0 <= package.age_s <= 0.1
    (reading,) = view.readings
    assert (reading.sensor, reading.values) == ("samples", (0.5, 0.25))


def test_an_object_that_is_not_heard_any_more_stops_the_robot(path, place):
    with open_fleet(mission(path), Alone()) as link, host_for(path, place) as host:
        exchange(link, host, lambda view: not view.fault)
        end_s = time.monotonic() + 0.12
        while time.monotonic() < end_s:
            host.listen(0.005)
            host.publish_object("package", time.monotonic(), (1.0, 2.0, 0.1, 0.2, 0.5, -0.3))
            host.publish(Kind.SENSOR, 0, time.monotonic(), (0.5, 0.25), "samples")
            link.locate(bridge_state())
        fault = until(lambda: link.team(link.locate(bridge_state())).fault)
        assert "stream is older than 0.1 s" in fault
        exchange(link, host, lambda view: not view.fault)


def test_a_recording_tells_of_objects_beside_robots(path, tmp_path, monkeypatch):
    turn = [math.remainder(3.0 + 0.005 * k, math.tau) for k in range(20_000)]
    lines = [
        {"t": 0.01 * k, "object": name, "x": 0.002 * k, "y": -1.0, "heading": turn[k]}
        for k in range(20_000)
        for name in ("package", "person")
    ]
    file = tmp_path / "poses.jsonl"
    file.write_text("\n".join(map(json.dumps, lines)))
    text = path.read_text()
    path.write_text(text.replace("sensors = ", "# "))
    signals = SimpleNamespace(reason="")
    monkeypatch.setattr(command, "StopSignals", lambda: contextlib.nullcontext(signals))
    flags = ["--fleet", str(path), "--replay", str(file)]
    player = threading.Thread(target=command.main, args=(flags,))
    player.start()
    with open_fleet(mission(path), Alone()) as link:

        def look():
            view = link.team(link.locate(bridge_state()))
            return view if not view.fault else None

        view = until(look, pause_s=0.005)
    signals.reason = "enough"
    player.join(HANG_S)
    for each in view.tracked:
        assert each.velocity_m_s == pytest.approx((0.2, 0.0), abs=1e-9)
        assert each.yaw_rate_rad_s == pytest.approx(0.5)  # also where the heading wraps


def test_a_heading_that_wraps_turns_on():
    fit = MotionFit()
    for k in range(40):
        found = fit.add(0.01 * k, (0.0, 0.0), math.remainder(3.0 + 0.02 * k, math.tau))
        assert found is None or found[1] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ('{"t": 0, "object": "dog", "x": 0, "y": 0}', "object 'dog' is not told from here"),
        ('{"t": 0, "x": 0, "y": 0}', "line 1: a line has either `robot` or `object`"),
        ('{"t": 0, "robot": 0, "object": "person", "x": 0, "y": 0}', "either `robot` or `object`"),
        ('{"t": 0, "object": "person", "ranges": [1]}', "`ranges` are a robot's, no object's"),
    ],
)
def test_recordings_that_do_not_fit_are_refused_in_one_line(path, tmp_path, capsys, line, wanted):
    file = tmp_path / "poses.jsonl"
    file.write_text(line)
    assert edge_pose(["--fleet", str(path), "--replay", str(file)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert wanted in said


def test_motive_must_be_told_which_body_an_object_is(path, capsys):
    assert edge_pose(["--fleet", str(path), "--natnet", "127.0.0.1"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "tracked[0].rigid_body: missing" in said


def one_object(**fields):
    return "\n[[tracked]]\n" + "".join(f"{key} = {value}\n" for key, value in fields.items())


ALONE = "[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (one_object(pose='"10.0.0.5:1"'), "tracked[0].name: missing"),
        (one_object(name='""'), "tracked[0]: `name` must be 1 to 60 printable characters"),
        (one_object(name='"door"', colour='"red"'), "tracked[0].colour: unknown key"),
        (one_object(name='"door"', pose='"10.0.0.5"'), "tracked[0]: `pose` must be a stream's address"),
        (one_object(name='"door"', radius_m=0), "tracked[0]: `radius_m` must lie in"),
        (one_object(name='"door"', start_m="[0, 1e9]"), "tracked[0]: `start_m` must lie in"),
        (one_object(name='"door"') * 2, "tracked[1].name: 'door' is taken by tracked[0]"),
        (one_object(name='"door"', pose='"10.0.0.5:1"'), "tracked[0].pose: means nothing without [carrier]"),
    ],
)
def test_tables_that_do_not_hold_together_are_refused_in_one_line(tmp_path, text, wanted):
    path = tmp_path / "fleet.toml"
    path.write_text(ALONE + text)
    with pytest.raises(ConfigError) as error:
        load_fleet(path)
    assert str(path) in str(error.value)
    assert wanted in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_an_object_without_a_stream_is_refused_in_one_line(path):
    path.write_text("".join(line for line in path.read_text().splitlines(True) if "pose" not in line))
    with pytest.raises(ConfigError) as error:
        load_fleet(path)
    assert "tracked[0].pose: missing: with [carrier] nothing else tells where 'package' is" in str(
        error.value
    )


def test_names_that_share_a_number_on_the_wire_are_refused(tmp_path):
    found = {}
    for number in range(1_000_000):
        name = f"object {number}"
        if found.setdefault(tag_of(name), name) != name:
            break
    path = tmp_path / "fleet.toml"
    path.write_text(ALONE + one_object(name=f'"{found[tag_of(name)]}"') + one_object(name=f'"{name}"'))
    with pytest.raises(ConfigError, match="share a number on the wire; rename one"):
        load_fleet(path)
