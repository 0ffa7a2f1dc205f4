"""Meetings head-on: what counts as which side, by hand, and that a flow policy knows both."""

import math

import msgspec
import numpy as np
import pytest
import torch

from benchmarks.common.result_file import read_result
from benchmarks.paper.methods import decider
from benchmarks.paper.modes import modes_command as modes
from benchmarks.paper.modes.meetings import HALF_WAY_M, MeetingJudge, Meetings, head_on, meet
from benchmarks.paper.modes.modes_command import RESULTS, SCENES, MeetingRow, modes_table, summed_up, two_ways
from benchmarks.paper.modes.picture import along
from benchmarks.paper.settings import UNGUIDED, Mean
from benchmarks.paper.tasks import TASKS
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import packaged_bundle
from export.scenarios.scenario import Transition

EAST = np.array([[1.0, 0.0]])
NO_REWARD = torch.zeros(1, 2)


class Standing:
    """A world whose robots stand somewhere."""

    def __init__(self, places):
        self._position = torch.tensor([places])

    def motion(self):
        return self._position, torch.zeros_like(self._position)


def follow(first, second, heading=EAST, arrived=None, touching=None):
    """One meeting of two robots with tracks [(x, y), ...]."""
    judge = MeetingJudge(np.asarray(heading))
    for step, places in enumerate(zip(first, second, strict=True)):
        flags = [torch.tensor([step == when]) for when in (arrived, touching)]
        judge.add(Standing(places), Transition(NO_REWARD, *flags, torch.tensor([False])))
    return judge.meetings()


@pytest.mark.parametrize(("y", "side"), [(0.1, 1), (-0.1, -1)])
def test_the_side_is_where_the_robot_is_when_it_gets_past(y, side):
    met = follow([(-0.5, -y), (-0.1, y), (0.1, y), (0.5, -y)], [(0.5, y), (0.1, -y), (-0.1, -y), (-0.5, y)])
    assert met.side.tolist() == [side]


def test_sides_turn_with_the_heading_and_agree_for_both_robots():
    north = np.array([[0.0, 1.0]])
    west_of_it = [(-0.1, -0.5), (-0.1, 0.5)]
    east_of_it = [(0.1, 0.5), (0.1, -0.5)]
    assert follow(west_of_it, east_of_it, north).side.tolist() == [1]
    assert follow(east_of_it, west_of_it, -north).side.tolist() == [1]


def test_robots_that_never_get_past_stand_off():
    met = follow([(-0.5, 0.0), (-0.1, 0.0)], [(0.5, 0.0), (0.1, 0.0)])
    assert met.side.tolist() == [0]
    assert np.isinf(met.arrival[0])


def test_arrival_is_the_first_step_and_only_contacts_before_it_count():
    tracks = [(-0.5, 0.1), (0.5, 0.1), (0.6, 0.1)], [(0.5, -0.1), (-0.5, -0.1), (-0.6, -0.1)]
    late, early = follow(*tracks, arrived=1, touching=2), follow(*tracks, arrived=1, touching=0)
    assert (late.arrival[0], late.collided[0], early.collided[0]) == (2, False, True)


def test_scenes_with_two_ways_have_a_tenth_of_the_passes_on_the_rarer_side():
    even, rare, enough = [1, -1] * 10, [1] * 19 + [-1], [1] * 18 + [-1] * 2
    never, once = [0] * 20, [1] + [0] * 19
    assert two_ways(np.array([even, rare, enough, never, once])).tolist() == [True, False, True, False, False]


def test_a_scene_is_the_same_start_turned():
    world = head_on(np.array([[1.0, 0.0], [0.0, 1.0]]))
    position, goal = (world.state_dict()[name].numpy() for name in ("position", "goal"))
    assert position[0, 0] == pytest.approx([-HALF_WAY_M, 0.0])
    assert position[1, 0] == pytest.approx([0.0, -HALF_WAY_M])
    assert np.array_equal(position[:, :2], goal[:, 1::-1])
    assert np.array_equal(position[:, 2:], goal[:, 2:])


def test_pictures_turn_every_way_along_x():
    angle = np.array([0.3, 2.0])
    heading = np.stack([np.cos(angle), np.sin(angle)], -1)
    left = np.stack([-heading[:, 1], heading[:, 0]], -1)
    turned = along((2.0 * heading + 0.5 * left)[None, :, None], angle)
    assert turned[0, :, 0] == pytest.approx(np.array([[2.0, 0.5]] * 2))


def test_a_flow_passes_on_both_sides_of_the_same_start_and_its_mean_on_one():
    bundle, angle = packaged_bundle("navigation"), np.zeros(24)
    still = modes.contestants()["flow from its mean"]
    (sampled, _), (mean, tracks) = (
        meet(decider(TASKS["navigation"], settings, bundle), angles, seed=0)
        for settings, angles in ((UNGUIDED, angle), (still, angle[:4]))
    )
    assert {1, -1} <= set(sampled.side.tolist())
    assert len(set(mean.side.tolist())) == 1
    assert tracks[0, 0, 0] == pytest.approx([-HALF_WAY_M, 0.0])


def test_rows_add_up_to_all_meetings():
    side = np.array([1, -1, 0, 1] * SCENES)
    met = Meetings(side, np.where(side == 0, np.inf, 50.0), side == 0)
    row = summed_up(UNGUIDED, 1, met, "policy")
    assert (row.left, row.right, row.stand_off, row.collided) == (50.0, 25.0, 25.0, 25.0)
    assert (row.two_ways, row.seconds_to_goal) == (100.0, pytest.approx(5.0))
    assert "| none, eta 0, noise 1 | 50.0 | 25.0 | 25.0 | 100.0 | 25.0 | 5.0 |" in modes_table([row])


def test_nobody_arriving_is_no_time():
    nobody = Meetings(np.zeros(SCENES, np.int64), np.full(SCENES, math.inf), np.zeros(SCENES, bool))
    row = summed_up(Mean(), 1, nobody, "policy")
    assert row.seconds_to_goal is None
    assert "never" in modes_table([row])


def test_the_command_writes_rows_and_a_picture(tmp_path):
    path = tmp_path / "rows.json"
    assert modes.main(["--samples", "1", "--seeds", "1", "--json", str(path)]) == 0
    assert len(read_result(path, list[MeetingRow])) == 4
    assert (tmp_path / "paper" / "modes.png").stat().st_size > 0


def test_the_recorded_rows_are_those_of_the_settings_of_today():
    rows = read_result(RESULTS, list[MeetingRow])
    asked = {(settings, seed) for settings in modes.contestants().values() for seed in modes.SEEDS}
    assert {(row.settings, row.seed) for row in rows} == asked


def test_rows_with_what_nobody_reads_are_refused(tmp_path):
    rows = msgspec.json.decode(RESULTS.read_bytes())
    (tmp_path / "rows.json").write_bytes(msgspec.json.encode([rows[0] | {"mode": "none, eta 10"}]))
    with pytest.raises(ConfigError, match="unknown field `mode`"):
        read_result(tmp_path / "rows.json", list[MeetingRow])


def test_policies_that_are_missing_are_one_clear_line(tmp_path):
    with pytest.raises(ConfigError, match="no bundle of mafpo-chain on navigation with seed 1"):
        modes.main(["--policies", str(tmp_path), "--json", str(tmp_path / "rows.json")])
