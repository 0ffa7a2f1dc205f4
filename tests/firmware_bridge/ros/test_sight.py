"""A team in sight of genuine ROS: what a robot tells its watcher is what a stranger's node hears."""

import json
import socket
import subprocess
import sys

import pytest
from msgspec.structs import replace
from ports import free_port
from ros_peers import (
    BUILD,
    DEBIAN,
    SUPPORT,
    domain,
    environment,
    master,
    needs_ros1,
    needs_ros2,
    site_packages,
)
from waiting import HANG_S
from watch_fakes import KEY, status

from edge_runtime.telemetry.status import encode
from firmware_bridge.ros.sight import ERROR, OK, STALE, fare


def test_what_is_said_of_a_robot():
    told = status()
    driving = fare(told, silent=False)
    assert (driving.level, driving.message) == (OK, "driving")
    assert ("cost of safety_margin", "0.125") in driving.values
    assert ("limit of speed_limit", "0.3 m/s") in driving.values
    stopped = fare(replace(told, stop_reason="a teammate is silent"), silent=False)
    assert (stopped.level, stopped.message) == (ERROR, "a teammate is silent")
    assert fare(told, silent=True)[:2] == (STALE, "silent")
    assert fare(replace(told, ended="SIGTERM"), silent=True)[:2] == (STALE, "SIGTERM")
    assert fare(None, silent=True)[:2] == (STALE, "never heard")


@pytest.fixture(params=[pytest.param(1, marks=needs_ros1), pytest.param(2, marks=needs_ros2)])
def ros(request, monkeypatch):
    if request.param == 1:
        with master(monkeypatch):
            yield 1, DEBIAN, "/usr/bin/python3"
    else:
        domain(monkeypatch)
        yield 2, str(site_packages("kilted")), str(BUILD / "kilted" / "bin" / "python")


@pytest.mark.integration
def test_a_strangers_node_hears_the_team(ros, tmp_path):
    kind, folder, python = ros
    place = free_port()
    key = tmp_path / "team.key"
    key.write_text(KEY.hex())
    key.chmod(0o600)
    fleet = tmp_path / "team.toml"
    fleet.write_text(
        '[carrier]\nkey = "team.key"\n\n[watch]\naddress = "{}:{}"\n\n'.format(*place)
        + '[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [1.0, 0.0]\naddress = "127.0.0.1:1"\n'
    )
    command = [sys.executable, "-m", "firmware_bridge.ros.sight", "--fleet", str(fleet), "--ros", str(kind)]
    sight = subprocess.Popen([*command, "--ros-path", folder])
    reader = subprocess.Popen(
        [python, "reader.py", str(kind)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=SUPPORT / "peers", env=environment(),
    )  # fmt: skip
    robot = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    heard, sequence = {}, 0
    try:
        while not {"path", "diagnostics", "marker"} <= heard.keys():
            for _ in range(10):
                sequence += 1
                robot.sendto(
                    encode(status(sequence=sequence, stop_reason="the operator says so"), KEY), place
                )
            words = json.loads(reader.stdout.readline())
            if words.get("level") != STALE:
                heard[next(iter(words))] = words
    finally:
        sight.terminate()
        reader.kill()
        assert sight.wait(HANG_S) == 0
    assert heard["path"]["path"] == pytest.approx([0.1, 0.2])
    assert heard["path"]["frame"] == "team"
    assert heard["marker"] == {"marker": 0, "place": [0.1, 0.2]}
    said = heard["diagnostics"]
    assert (said["diagnostics"], said["level"], said["message"]) == ("robot_0", ERROR, "the operator says so")
    assert said["values"]["cost of safety_margin"] == "0.125"
