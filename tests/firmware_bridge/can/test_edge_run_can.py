"""edge-run drives a chassis on a real bus between processes, through its guard."""

import json
import signal
import subprocess
import sys

import pytest
from bundles import write_straight_bundle
from can_peers import Chassis, multicast_address, patient_profile
from waiting import HANG_S, until

from edge_runtime.run import edge_run as run


@pytest.fixture
def address():
    return multicast_address()


@pytest.fixture
def chassis(address):
    with Chassis(address) as peer:
        yield peer


def test_edge_run_enables_drives_and_stops_a_chassis(chassis, address, tmp_path):
    report, bundle = tmp_path / "run.json", write_straight_bundle(tmp_path / "straight")
    fleet = tmp_path / "alone.toml"
    fleet.write_text("[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [3.0, 1.0]\n")
    command = [
        *(sys.executable, "-m", "edge_runtime.run", "--robot-id", "0", "--rate", "50", "--fleet", str(fleet)),
        *("--bridge", "can", "--bus", address, "--profile", patient_profile(), "--arm"),
        *("--guard-deadline", "0.5", "--policy", str(bundle), "--json", str(report)),
    ]

    def driven():
        """Whether it drove until it was told to end: on a busy machine its guard's deadline may pass."""
        chassis.frames.clear()
        runtime = subprocess.Popen(command)
        try:
            chassis.wait(lambda: len(chassis.data(0x111)) > 20 or runtime.poll() is not None)
            runtime.send_signal(signal.SIGTERM)
            code = runtime.wait(HANG_S)
        finally:
            runtime.kill()
        starved = "no fresh command" in json.loads(report.read_text())["stop_reason"]
        assert starved or code == 0
        return not starved

    until(driven)
    assert any(data[:2] != b"\0\0" for data in chassis.data(0x111))
    assert chassis.data(0x111)[-1] == bytes(8)
    written = json.loads(report.read_text())
    assert written["ticks"] > 20
    assert (written["bridge"], written["stop_reason"]) == ("can", "SIGTERM")


def test_a_robot_of_a_team_does_not_drive_blind(tmp_path, capsys):
    bundle = write_straight_bundle(tmp_path / "straight")
    flags = ["--robot-id", "0", "--rate", "50", "--bridge", "can", "--bus", "can0", "--profile", "agilex_v2"]
    assert run.main([*flags, "--policy", str(bundle)]) == 2
    assert "carrier: missing" in capsys.readouterr().err
