"""Meetings head-on: what counts as which side, by hand, and that a flow policy knows both."""

import msgspec
import numpy as np
import pytest

from benchmarks.common.result_file import read_result
from benchmarks.paper.methods import decider
from benchmarks.paper.modes import modes_command as modes
from benchmarks.paper.modes.meetings import HALF_WAY_M, along, head_on, meet, sides
from benchmarks.paper.modes.modes_command import RESULTS, SCENES, MeetingRow, modes_table, summed_up, two_ways
from benchmarks.paper.settings import UNGUIDED
from benchmarks.paper.tasks import TASKS
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import packaged_bundle


def side_of(first, second, angle=0.0):
    """One meeting of two robots with tracks [(x, y), ...]."""
    (found,) = sides(along(np.stack([first, second], 1)[:, None], np.array([angle])))
    return found


@pytest.mark.parametrize(("y", "side"), [(0.1, 1), (-0.1, -1)])
def test_the_side_is_where_the_robot_is_when_it_gets_past(y, side):
    first = [(-0.5, -y), (-0.1, y), (0.1, y), (0.5, -y)]
    assert side_of(first, [(0.5, y), (0.1, -y), (-0.1, -y), (-0.5, y)]) == side


def test_sides_turn_with_the_heading_and_agree_for_both_robots():
    west_of_it = [(-0.1, -0.5), (-0.1, 0.5)]
    east_of_it = [(0.1, 0.5), (0.1, -0.5)]
    assert side_of(west_of_it, east_of_it, np.pi / 2) == 1
    assert side_of(east_of_it, west_of_it, -np.pi / 2) == 1


def test_robots_that_never_get_past_stand_off():
    assert side_of([(-0.5, 0.0), (-0.1, 0.0)], [(0.5, 0.0), (0.1, 0.0)]) == 0


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
    sampled, mean = (
        meet(decider(TASKS["navigation"], settings, bundle), angles, seed=0)
        for settings, angles in ((UNGUIDED, angle), (still, angle[:4]))
    )
    assert {1, -1} <= set(sides(sampled).tolist())
    assert len(set(sides(mean).tolist())) == 1


def test_rows_add_up_to_all_meetings():
    row = summed_up(UNGUIDED, 1, np.array([1, -1, 0, 1] * SCENES), "policy")
    assert (row.left, row.right, row.stand_off, row.two_ways) == (50.0, 25.0, 25.0, 100.0)
    assert "| none, eta 0, noise 1 | 50.0 | 25.0 | 25.0 | 100.0 |" in modes_table([row])


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
