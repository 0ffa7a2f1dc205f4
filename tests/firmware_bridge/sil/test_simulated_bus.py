"""--bus sim: the commands of a CAN robot with nothing plugged in."""

import json

import pytest
from bundles import write_straight_bundle
from waiting import until

from edge_runtime.doctor import edge_doctor
from edge_runtime.run import edge_run
from firmware_bridge.can.bus import CanBus
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.kinematics.base import BaseMotion

FLAGS = ["--robot-id", "0", "--rate", "50", "--bridge", "can", "--bus", "sim"]
SPEED = "MotionState.Linear"


@pytest.fixture
def alone(tmp_path):
    fleet = tmp_path / "alone.toml"
    fleet.write_text("[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [0.5, 0.0]\n")
    policy = write_straight_bundle(tmp_path / "straight")
    return ["--fleet", str(fleet), "--policy", str(policy), "--no-log"]


def test_edge_run_drives_it_through_its_guard(alone, tmp_path):
    report = tmp_path / "run.json"
    flags = [*FLAGS, *alone, "--profile", "agilex_v2", "--guard-deadline", "1", "--arm", "--duration", "4"]

    def driven():
        """The report of a run whose guard did not stop it: on a busy machine its deadline may pass."""
        code, written = edge_run.main([*flags, "--json", str(report)]), json.loads(report.read_text())
        starved = "no fresh command" in written["stop_reason"]
        assert starved or code == 0
        return None if starved else written

    written = until(driven)
    assert (written["bridge"], written["failed"]) == ("can", False)
    assert written["max_speed_m_s"] > 0.0


def test_the_doctor_finds_nothing_that_stands_in_its_way(alone, capsys):
    edge_doctor.main([*FLAGS, *alone, "--profile", "agilex_v2", "--arm"])
    lines = dict(line.split(maxsplit=2)[1::-1] for line in capsys.readouterr().out.splitlines())
    assert [lines[check] for check in ("CAN", "feedback", "firmware", "stopping")] == ["ok"] * 4


def test_the_chassis_moves_only_once_it_is_enabled():
    path = profile_path("agilex_v2")
    profile = load_profile(path)
    codec, bus = CanCodec(profile, path), CanBus("sim")
    bus.open()

    def speeds():
        """Ask it to drive; what it says of its speed since it was asked last."""
        for frame in codec.encode(BaseMotion(0.5)):
            assert bus.send(frame)
        decoded = filter(None, map(codec.decode, bus.receive()))
        return [one.values[SPEED] for one in decoded if SPEED in one.values]

    try:
        still = [speed for _ in range(5) for speed in until(speeds)]
        assert not any(still)
        for step in profile.enable:
            bus.send(codec.encode_step(step))
        until(lambda: any(speed > 0.1 for speed in speeds()))
        assert bus.send(Frame(0x7FF, b"nobody's")) and bus.send(Frame(0x1ABCDEF, b"", extended=True))
    finally:
        bus.close()


def test_another_base_is_refused(alone, capsys):
    assert edge_run.main([*FLAGS, *alone, "--profile", "agilex_hunter"]) == 2
    assert "--profile agilex_v2" in capsys.readouterr().err
