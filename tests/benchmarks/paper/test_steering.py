"""The steering experiment: scenes that can be satisfied, a judge by hand, and rows that resume."""

import dataclasses

import msgspec
import pytest
import torch
from paths import ROOT

from benchmarks.common.result_file import read_result
from benchmarks.paper.methods import decider
from benchmarks.paper.settings import Guided
from benchmarks.paper.steering import steering_command
from benchmarks.paper.steering.judge import SceneJudge
from benchmarks.paper.steering.rows import SteeringRow
from benchmarks.paper.steering.scenes import SCENES, head_on
from benchmarks.paper.steering.steering_page import scene_table, steering_page
from benchmarks.paper.steering.ways import ways
from benchmarks.paper.tasks import TASKS
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import Geofence
from edge_runtime.policy.bundle import packaged_bundle
from export.episodes.neighbourhood import Setting
from export.episodes.play import play


@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_starts_and_ends_outside_of_its_zones(scene):
    own = SCENES[scene]
    state = own.start(20, 3).state_dict()
    zones = [each for each in own.objectives if isinstance(each, Geofence)]
    for place in (state["position"], state["goal"]):
        assert place.shape == (20, 4, 2)
        for zone in zones:
            assert ((place - torch.tensor(zone.centre_m)).norm(dim=-1) > zone.radius_m).all()


def moved(world, position):
    state = world.state_dict()
    state["position"] = torch.tensor([position], dtype=torch.float32)
    state["velocity"] = torch.zeros(1, 4, 2)
    world.load_state_dict(state)
    return world.step(torch.zeros(1, 4, 2))


@pytest.mark.parametrize(("side", "right"), [(0.2, True), (-0.2, False)])
def test_robots_that_meet_must_pass_on_their_right(side, right):
    world, judge = head_on(1, 0), SceneJudge(SCENES["meeting"], 1)
    goals = world.state_dict()["goal"][0].tolist()
    parked = goals[2:]
    for track in ([[side, -0.3], [-side, 0.3]], [[side, 0.1], [-side, -0.1]], goals[:2]):
        judge.add(world, moved(world, [*track, *parked]))
    assert judge.satisfied().tolist() == judge.arrived().tolist() == [right]
    assert not judge.running.any()


def test_a_step_within_a_zone_counts_against_that_zone_alone():
    scene = SCENES["six"]
    world, judge = scene.start(1, 0), SceneJudge(scene, 1)
    corners = [[0.9, 0.9], [-0.9, 0.9], [0.9, -0.9]]
    judge.add(world, moved(world, [[0.5, 0.1], *corners]))
    judge.add(world, moved(world, [[0.0, 0.0], *corners]))
    assert judge.broken()[0].tolist() == [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]


def test_a_flat_field_leaves_correction_alone_and_changes_what_is_steered():
    def actions(mode, **changes):
        seen = []
        settings = Guided(guidance=GuidanceSettings(mode=mode, scale=10.0), **changes)
        task = dataclasses.replace(TASKS["navigation"], steps=1)
        world = SCENES["two"].start(3, 0)
        state = world.state_dict()
        state["velocity"] = torch.full_like(state["position"], 0.3)
        world.load_state_dict(state)
        step = world.step
        world.step = lambda action: seen.append(action) or step(action)
        judge = SceneJudge(SCENES["two"], 3)
        play(
            world,
            decider(task, settings, packaged_bundle("navigation")),
            judge,
            Setting(episodes=3, episodes_seed=0),
            1,
            0,
        )
        return seen[0]

    assert not torch.equal(actions("none"), actions("none", jacobian=False))


def test_every_way_along_the_flow_has_as_many_scales():
    assert {len(tried) for name, tried in ways(1.0).items() if not name.startswith("corrected")} == {2}
    assert all(one.guidance.start_noise == 0.0 for tried in ways(0.0).values() for one in tried)


def test_rows_resume_and_the_best_scale_counts(tmp_path, monkeypatch, capsys):
    few = {name: tried[:2] for name, tried in ways(1.0).items() if name in ("corrected only", "cone")}
    monkeypatch.setattr(steering_command, "ways", lambda _noise: few)
    path = tmp_path / "rows.json"
    asked = ["--scenes", "six", "--episodes", "2", "--seeds", "1", "--json", str(path)]
    assert steering_command.main(asked) == 0
    rows = read_result(path, list[SteeringRow])
    assert [row.way for row in rows] == ["corrected only", "cone", "cone"]
    rows[1:] = [
        msgspec.structs.replace(row, success=share) for row, share in zip(rows[1:], (50.0, 75.0), strict=True)
    ]
    path.write_bytes(msgspec.json.encode(rows[1:]))
    assert steering_command.main(asked) == 0
    assert len(read_result(path, list[SteeringRow])) == 3
    assert "| cone | 30 | 75.0 " in capsys.readouterr().out
    assert scene_table(rows[1:2]).splitlines()[2].startswith("| cone | 3 | 50.0")


def test_the_documentation_has_the_recorded_tables():
    page = steering_page(read_result(steering_command.RESULTS, list[SteeringRow]))
    assert (steering_command.RESULTS.parent / "paper" / "steering.md").read_text() == page
    shown = (ROOT / "docs" / "guidance.md").read_text()
    assert all(line in shown for line in page.splitlines() if line.startswith("|"))
