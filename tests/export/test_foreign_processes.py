"""Policies of somebody else's, each driven by four real `edge-run`; drones by MAVLink and guards."""

import json
import os
import subprocess
import sys
from contextlib import ExitStack

import pytest
from copters import flying
from foreign_policies import POLICIES
from foreign_teams import CEILING_M, asked, distance_m, imported, robots, starts_m
from ports import free_port
from waiting import HANG_S

from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import Tick

pytestmark = pytest.mark.integration
ROBOTS = range(4)
COPTER = ("--bridge", "mavlink", "--mavlink-autopilot", "ardupilot_copter", "--arm", "--guard-deadline", "1")
"""A busy machine may keep a runtime from its guard for longer than the deadline that a robot should have."""


class Team:
    """Four processes of one policy."""

    def __init__(self, name, folder, stack):
        self.name, self.folder = name, folder
        dims = imported(name, folder).manifest.motion.dims
        (folder / "team.key").write_text("ab" * 32)
        (folder / "team.key").chmod(0o600)
        table = robots(dims, lambda _: 'address = "{}:{}"'.format(*free_port()))
        (folder / "team.toml").write_text(f'{asked(name, folder)}[carrier]\nkey = "team.key"\n{table}')
        ports = stack.enter_context(flying(starts_m(dims))) if name == "drone" else []
        self.processes = []
        for robot_id in ROBOTS:
            link = (*COPTER, "--mavlink", f"udpout:127.0.0.1:{ports[robot_id]}") if ports else ()
            self.processes.append(stack.enter_context(self._start(robot_id, link)))
        stack.callback(self._end)

    def reports(self):
        for process in self.processes:
            assert process.wait(HANG_S) == 0, process.stderr.read()
        return [json.loads((self.folder / f"{robot_id}.json").read_text()) for robot_id in ROBOTS]

    def places_m(self):
        """Where its robots were, by their logs."""
        logs = [log for robot_id in ROBOTS for log in (self.folder / f"log{robot_id}").glob("*.mcap")]
        return [
            record.state.own.position_m
            for log in logs
            for record in read_log(log)
            if isinstance(record, Tick)
        ]

    def _end(self):
        for process in self.processes:
            process.kill()

    def _start(self, robot_id, link):
        flags = ["--fleet", self.folder / "team.toml", "--policy", self.folder / self.name, *link]
        flags += ["--robot-id", robot_id, "--rate", "20", "--duration", HANG_S]
        flags += ["--json", self.folder / f"{robot_id}.json", "--log-dir", self.folder / f"log{robot_id}"]
        return subprocess.Popen(
            [sys.executable, "-m", "edge_runtime.run", *map(str, flags)],
            env={**os.environ, "XDG_STATE_HOME": str(self.folder / "state")},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )


@pytest.fixture(scope="module")
def processes(tmp_path_factory):
    """All teams at once; they wait for nobody but their own."""
    with ExitStack() as stack:
        yield {name: Team(name, tmp_path_factory.mktemp(name), stack) for name in POLICIES}


@pytest.mark.parametrize("name", POLICIES)
def test_a_team_of_processes_reaches_its_goals_and_keeps_the_margin(processes, name):
    team = processes[name]
    for report in team.reports():
        assert (report["policy"], report["failed"], report["goals_reached"]) == (name, False, 4)
        assert report["stop_reason"] == "goals held"
        assert report["bridge"] == ("mavlink" if name == "drone" else "sim")
        # What a robot knows of the others is up to a period old, so that they come a little nearer.
        assert report["min_separation_m"] > distance_m(name) - 0.03
    if name == "drone":
        assert all(len(place) == 3 and place[2] < CEILING_M + 0.05 for place in team.places_m())
