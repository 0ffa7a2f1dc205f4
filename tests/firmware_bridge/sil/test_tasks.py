"""The packaged tasks as teams of processes: the world's physics, its streams, a short run of the whole."""

import json
import math
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sil_reports import LENIENT, unstarved
from waiting import until

from edge_runtime.config.fleet import load_fleet
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState
from edge_runtime.network.stream_wire import Kind
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.run.flags import make_mission, read_flags
from edge_runtime.team.membership import Alone, open_fleet
from export.scenarios.firmware_world import VmasWorld
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.edge_sil import main as edge_sil
from firmware_bridge.sil.firmware import sources as streams
from firmware_bridge.sil.firmware.node import STEP_S
from firmware_bridge.sil.firmware.planar_world import PlanarWorld
from firmware_bridge.sil.firmware.sources import Sources
from firmware_bridge.sil.firmware.world import Standing
from firmware_bridge.sil.harness.robots import robot_arguments
from firmware_bridge.sil.scenario.scenario import Request, prepare, robot_bundle

AHEAD_M = 0.2


def scenario(folder, task, **others):
    return prepare(Request(task=task, rate_hz=10.0, **others), folder)


def world_of(ready):
    fleet = load_fleet(Path(ready.stations[0].fleet_file))
    manifests = [robot_bundle(fleet, robot, "").manifest for robot in fleet.robots]
    return fleet, manifests, VmasWorld(fleet, manifests, standing(fleet), STEP_S, 0.1)


def standing(fleet):
    return [Standing(robot.start_m[:2], 0.0, AHEAD_M) for robot in fleet.robots]


def test_without_a_load_its_robots_follow_as_in_the_other_world(tmp_path):
    fleet, manifests, world = world_of(scenario(tmp_path, "sampling"))
    plain = PlanarWorld(manifests, standing(fleet), STEP_S)
    starts = plain.position_m.copy()
    for _ in range(300):
        motions = [BaseMotion(0.1, 0.0, 0.2), BaseMotion(0.05, 0.0, -0.1), BaseMotion(-0.1)]
        world.step(motions)
        plain.step(motions)
    # One pushes as hard as it can, the other as hard as the policy meant: both come to that velocity.
    np.testing.assert_allclose(world.velocity_m_s, plain.velocity_m_s, atol=0.03)
    assert np.linalg.norm(world.position_m - starts, axis=1).min() > 0.1


def test_a_team_lifts_its_load_no_harder_than_it_is_told(tmp_path):
    _, manifests, world = world_of(scenario(tmp_path, "balance"))
    force, mass_kg = 0.9, manifests[0].motion.mass_kg
    height = [world.objects()[0].position_m[1]]
    for _ in range(300):
        # The velocity upwards that a policy's force leads to, as each base turns it into forward and yaw.
        velocity = world.velocity_m_s[:, 1] * 0.75 + 0.1 * force / mass_kg
        headings = [world.state(robot).heading_rad for robot in range(5)]
        told = zip(velocity.tolist(), headings, strict=True)
        world.step([BaseMotion(up * math.sin(turn), 0.0, up * math.cos(turn) / AHEAD_M) for up, turn in told])
        height.append(world.objects()[0].position_m[1])
    assert height[-1] > height[0] + 0.1
    for _ in range(300):
        world.step([BaseMotion()] * 5)
    assert world.objects()[0].position_m[1] < height[-1] + 0.05


@pytest.mark.parametrize("task", ["balance", "sampling"])
def test_every_robot_is_told_of_itself_its_load_and_its_samples(tmp_path, task):
    ready = scenario(tmp_path, task)
    fleet, _, world = world_of(ready)
    flags, _ = read_flags(robot_arguments(ready, ready.stations[1]))
    mission = make_mission(flags)
    with Sources(fleet, world) as sources, open_fleet(mission, Alone()) as link:

        def look():
            sources.tell(time.monotonic())
            own = link.locate(RobotState(1, time.monotonic(), (0.0, 0.0), (0.0, 0.0)))
            view = own and link.team(own)
            return view if view and "stream" not in view.fault else None

        view = until(look, pause_s=0.005)
    assert view.own.position_m == pytest.approx(fleet.robots[1].start_m, abs=1e-6)
    assert [each.name for each in view.tracked] == [each.name for each in fleet.tracked]
    assert [(each.sensor, len(each.values)) for each in view.readings] == (
        [("nearby_samples", 8)] if task == "sampling" else []
    )


@pytest.mark.parametrize("bridge", ["can", "mavlink"])
def test_real_processes_carry_the_load(tmp_path, bridge):
    """What is judged does not depend on how busy the machine is: all drive, and hear of the load."""
    (tmp_path / "lenient.toml").write_text(LENIENT)
    report = tmp_path / "run.json"
    line = (sys.executable, "-m", "firmware_bridge.sil.edge_sil", "--task", "balance", "--bridge", bridge)
    flags = ("--duration", "4", "--limits", str(tmp_path / "lenient.toml"), "--json", str(report))

    def driven():
        done = subprocess.run([*line, *flags], capture_output=True, text=True, check=False)
        return unstarved((done, json.loads(report.read_text())))

    done, told = until(driven)
    assert done.returncode == 0, done.stderr
    (package,) = told["objects"]
    assert package["name"] == "package"
    assert "package: " in done.stdout
    assert len(told["robots"]) == 5
    for robot in told["robots"]:
        assert robot["accepted_messages"] > 0
        assert not any("stream" in reason and "older" not in reason for reason in robot["stopped_ticks"])


@pytest.mark.parametrize(
    ("flags", "wanted"),
    [
        (("--task", "balance", "--robots", "4"), "--robots 4: balance has 5"),
        (("--task", "balance", "--fleet", "team.toml"), "not allowed with argument"),
        (("--task", "chess"), "invalid choice: 'chess'"),
    ],
)
def test_flags_that_do_not_hold_together_are_refused(capsys, flags, wanted):
    assert edge_sil(list(flags)) == 2
    assert wanted in capsys.readouterr().err


def test_contacts_of_who_carries_together_are_not_judged(tmp_path):
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    assert scenario(tmp_path / "a", "balance").limits.run.collisions is None
    assert scenario(tmp_path / "b", "sampling").limits.run.collisions == 0


def test_a_machine_without_vmas_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_bridge.simulation.plants.importlib.util.find_spec", lambda _name: None)
    with pytest.raises(ConfigError, match="--task balance: 'vmas' needs a workstation's vmas"):
        scenario(tmp_path, "balance")


def test_streams_with_a_rate_of_their_own_are_told_at_it(monkeypatch):
    told, seen = [], []
    host = SimpleNamespace(publish=lambda *content: told.append(content), listen=lambda: None)
    monkeypatch.setattr(streams, "StreamHost", lambda *_: host)
    monkeypatch.setattr(streams, "team_key", lambda _: b"key")
    robot = SimpleNamespace(
        id=4, pose_place=("127.0.0.1", 1), ranges_place=None, address="127.0.0.1:2", sensors={}
    )
    fleet = SimpleNamespace(robots=(robot,), tracked=())
    manifest, there = packaged_bundle("navigation").manifest, Standing((0.0, 1.0), 0.5, 0.1)
    world = PlanarWorld([manifest], [there], 0.01)
    told_at_100_hz = Sources(fleet, world, lambda _, *pose: seen.append(pose), 100.0, 5.0)
    for now_s in (4.99, 5.0, 5.009, 5.0101, 5.05, 5.0599):
        told_at_100_hz.tell_due(now_s)
    assert [now_s for now_s, _ in seen] == [5.0, 5.0101, 5.05]
    assert len({x for _, x in seen}) == len(seen) == len(told)  # one pose is told from the next
    kind, robot_id, stamp_s, (x, y, *_, heading, _) = told[0]
    assert (kind, robot_id, stamp_s, heading) == (Kind.POSE, 4, 5.0, 0.5)
    assert (x, y) == pytest.approx((0.0, 1.0), abs=1e-3)
