"""Logs as bags of ROS 2, read back by a library that nobody of this project wrote."""

import math

import pytest
from logs import in_space, record, ticks, with_tick
from msgspec.structs import replace

from edge_runtime.errors import ConfigError
from edge_runtime.tools.replay import edge_replay

rosbags = pytest.importorskip("rosbags.highlevel")
typesys = pytest.importorskip("rosbags.typesys")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    (path,) = record(tmp_path_factory.mktemp("logs"))
    return path


def read(folder):
    """Topic, time and message of all that a bag holds."""
    with rosbags.AnyReader(
        [folder], default_typestore=typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    ) as bag:
        types = {connection.topic: connection.msgtype for connection in bag.connections}
        found = [
            (connection.topic, time_ns, bag.deserialize(data, connection.msgtype))
            for connection, time_ns, data in bag.messages()
        ]
        assert bag.message_count == len(found)
        return types, found


def test_a_bag_says_what_the_log_says(log, tmp_path, capsys):
    assert edge_replay.main([str(log), "--rosbag2", str(tmp_path / "bag")]) == 0
    assert f"{4 * len(ticks(log))} messages" in capsys.readouterr().out
    types, found = read(tmp_path / "bag")
    assert types == {
        "/robot_0/odom": "nav_msgs/msg/Odometry",
        "/robot_0/teammates": "geometry_msgs/msg/PoseArray",
        "/robot_0/command": "geometry_msgs/msg/TwistStamped",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    }
    per_topic = {topic: [message for name, _, message in found if name == topic] for topic in types}
    for tick, odometry, mates, command, diagnostics in zip(
        ticks(log), *(per_topic[topic] for topic in types), strict=True
    ):
        own, heading = tick.state.own, tick.state.own.heading_rad
        position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        assert (position.x, position.y, position.z) == (*own.position_m, 0.0)
        assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(heading)
        speed = math.hypot(odometry.twist.twist.linear.x, odometry.twist.twist.linear.y)
        assert speed == pytest.approx(math.hypot(*own.velocity_m_s))
        assert [(pose.position.x, pose.position.y) for pose in mates.poses] == [
            mate.state.position_m for mate in tick.state.teammates
        ]
        assert (command.twist.linear.x, command.twist.linear.y) == tick.command.velocity_m_s
        assert odometry.header.frame_id == "team"
        (status,) = diagnostics.status
        values = {pair.key: pair.value for pair in status.values}
        assert (status.level, status.message) == (0, "driving")
        assert values["tick"] == str(tick.inputs.number)
        assert float(values["cost of speed_limit"]) == pytest.approx(tick.action.costs[0], rel=1e-5)


def test_times_are_those_of_the_ticks_in_order(log, tmp_path):
    edge_replay.main([str(log), "--rosbag2", str(tmp_path / "bag")])
    times = [time_ns for _, time_ns, _ in read(tmp_path / "bag")[1]]
    passed = ticks(log)[-1].inputs.deadline_s - ticks(log)[0].inputs.deadline_s
    assert times == sorted(times)
    assert 1e-9 * (times[-1] - times[0]) == pytest.approx(passed, abs=1e-6)


def test_a_stop_is_an_error_with_its_reason(log, tmp_path):
    stopped = with_tick(
        log,
        tmp_path / "stopped.mcap",
        3,
        command=lambda command: replace(command, stop_reason="the operator says so"),
    )
    edge_replay.main([str(stopped), "--rosbag2", str(tmp_path / "bag")])
    _, found = read(tmp_path / "bag")
    stops = [m.status[0] for topic, _, m in found if topic == "/diagnostics" and m.status[0].level == 2]
    assert [stop.message for stop in stops] == ["the operator says so"]


def test_a_robot_in_space_keeps_its_height(log, tmp_path):
    edge_replay.main([str(in_space(log, tmp_path / "high.mcap", 3.0)), "--rosbag2", str(tmp_path / "bag")])
    _, found = read(tmp_path / "bag")
    heights = {m.pose.pose.position.z for topic, _, m in found if topic == "/robot_0/odom"}
    assert heights == {3.0}


def test_a_log_that_breaks_off_is_in_the_bag_up_to_there(log, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:-3000])
    assert edge_replay.main([str(cut), "--rosbag2", str(tmp_path / "bag")]) == 1
    assert "damaged" in capsys.readouterr().out
    assert read(tmp_path / "bag")[1]


def test_nothing_is_overwritten_and_other_questions_are_refused(log, tmp_path, capsys):
    (tmp_path / "bag").mkdir()
    assert edge_replay.main([str(log), "--rosbag2", str(tmp_path / "bag")]) == 2
    assert "is there already" in capsys.readouterr().err
    assert edge_replay.main([str(log), "--rosbag2", str(tmp_path / "no" / "bag")]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert edge_replay.main([str(log), "--rosbag2", str(tmp_path / "new"), "--policy", "x"]) == 2
    assert "--rosbag2 converts, it asks no question" in capsys.readouterr().err


def test_without_the_library_the_remedy_is_told(log, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mcap_ros2.writer", None)
    from edge_runtime.tools.replay.rosbag import write_bag  # noqa: PLC0415

    with pytest.raises(ConfigError, match=r"pip install 'cfpg-edge\[rosbag\]'"):
        write_bag([log], tmp_path / "bag")
    assert not (tmp_path / "bag").exists()
