"""edge-sil over genuine ROS: real processes and guards through every fault, in a place of their own."""

import json
import os
import subprocess
import sys

import pytest
from quiet import on_a_quiet_machine
from ros_peers import DEBIAN, libraries, needs_ros1, needs_ros2, site_packages
from sil_reports import LENIENT
from waiting import HANG_S

from firmware_bridge.sil import edge_sil
from firmware_bridge.sil.scenario.ros_place import DOMAINS, free_ros

FAULTS = """
[[fault]]
kind = "loss"
at_s = 0.2
for_s = 1.0
share = 0.3
[[fault]]
kind = "nan_pose"
robot = 3
at_s = 0.5
for_s = 0.3
[[fault]]
kind = "kill"
robot = 0
at_s = 2.0
[[fault]]
kind = "kill"
part = "guard"
robot = 1
at_s = 2.2
[[fault]]
kind = "emergency_stop"
robot = 2
at_s = 2.4
for_s = 1.0
[[fault]]
kind = "freeze"
robot = 3
at_s = 2.6
for_s = 0.5
"""


@pytest.fixture(params=[pytest.param("ros1", marks=needs_ros1), pytest.param("ros2", marks=needs_ros2)])
def ros(request, monkeypatch):
    """Flags of a ROS; what the shell says of others is nothing to the run."""
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")
    monkeypatch.setenv("ROS_NAMESPACE", "/somebody")
    if request.param == "ros1":
        return "--bridge", "ros1", "--ros-path", DEBIAN
    monkeypatch.setenv("LD_LIBRARY_PATH", libraries("kilted"))
    return "--bridge", "ros2", "--ros-path", str(site_packages("kilted"))


@pytest.mark.integration
@on_a_quiet_machine
def test_a_team_of_huskies_through_every_fault(ros, tmp_path):
    (tmp_path / "faults.toml").write_text(FAULTS)
    (tmp_path / "lenient.toml").write_text(LENIENT)
    files = ("--faults", tmp_path / "faults.toml", "--limits", tmp_path / "lenient.toml")
    flags = ("--rate", "10", "--duration", "5", *files, "--json", tmp_path / "run.json")
    command = [sys.executable, "-m", "firmware_bridge.sil.edge_sil", *ros, *map(str, flags)]
    (tmp_path / "tmp").mkdir(exist_ok=True)
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp")}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=3 * HANG_S, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((tmp_path / "run.json").read_text())
    assert (report["bridge"], report["verdict"], report["ended"]) == (ros[1], "passed", [])
    robots = report["robots"]
    assert robots[0]["stop_reason"] == ""
    assert "guard ended" in robots[1]["stop_reason"]
    assert robots[1]["firmware_timeouts"] == 1  # nobody was left to stop it but its own controller
    assert "the emergency stop is pressed (/robot_2/" in robots[2]["stop_reason"]
    assert "no fresh command" in robots[3]["stop_reason"]
    stops = [(fault["kind"], one) for fault in report["faults"] for one in fault["stops"]]
    assert [(kind, one["robot_id"]) for kind, one in stops] == [
        ("nan_pose", 3), ("kill", 0), ("kill", 1), ("emergency_stop", 2), ("freeze", 3)
    ]  # fmt: skip
    assert all(one["seconds"] is not None for _, one in stops)
    assert list((tmp_path / "tmp").iterdir()) == []


def test_a_place_of_ros_is_this_machines_and_nobody_elses(tmp_path):
    one, other = free_ros(1, tmp_path), free_ros(1, tmp_path)
    assert one.port != other.port
    assert one.environment["ROS_MASTER_URI"] == f"http://127.0.0.1:{one.port}"
    there = free_ros(2, tmp_path).environment
    assert int(there["ROS_DOMAIN_ID"]) in DOMAINS
    assert (there["ROS_AUTOMATIC_DISCOVERY_RANGE"], there["ROS_LOCALHOST_ONLY"]) == ("LOCALHOST", "1")
    assert there["ROS_LOG_DIR"] == one.environment["ROS_LOG_DIR"] == str(tmp_path)


def test_without_ros_nothing_is_started(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(edge_sil, "ProcessGroup", lambda *_: pytest.fail("started"))
    monkeypatch.setattr("sys.path", [path for path in sys.path if "dist-packages" not in path])
    assert edge_sil.main(["--bridge", "ros2", "--ros-path", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"--bridge ros2: rclpy is not installed, neither here nor in {tmp_path}; install ROS" in said
