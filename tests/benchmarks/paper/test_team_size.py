"""Teams of other sizes: who they are, that four robots are the task's own, and that rows resume."""

import msgspec
import numpy as np
import pytest

from benchmarks.common.result_file import read_result
from benchmarks.paper.team_size import team_size_command
from benchmarks.paper.team_size.measure import FARTHEST_GOAL_M, familiar, make_world
from benchmarks.paper.team_size.teams import Team, TeamRow, teams
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import ARENA_HALF_WIDTH_M, FACTS


def test_four_robots_at_the_trainings_density_are_the_task_itself():
    own = Team(robots=4)
    assert (own.half_width_m, own.steps, own.masses_kg) == (ARENA_HALF_WIDTH_M, NAVIGATION.steps, ())


def test_an_arena_has_as_many_robots_to_the_area_and_time_for_its_longest_way():
    for _, own in teams():
        for team in own:
            area = (2.0 * team.half_width_m) ** 2
            assert team.robots / area == pytest.approx(team.crowding * 4 / (2.0 * ARENA_HALF_WIDTH_M) ** 2)
            speed = 2.0 * 2.0**0.5 * team.half_width_m / (0.1 * team.steps)
            assert speed <= 0.64 * NAVIGATION.speed_limit.limit_m_s


@pytest.mark.parametrize(
    "team", [Team(robots=2), Team(robots=8, crowding=3.0), Team(robots=5, mixed=True)], ids=str
)
def test_a_world_holds_the_team(team):
    world = make_world(team, 4)
    position, _ = world.motion()
    assert position.shape == (4, team.robots, 2)
    assert position.abs().max() <= team.half_width_m
    assert world.observe().shape == (4, team.robots, FACTS.observation_dim)


def test_what_is_near_is_observed_as_it_is_and_what_is_far_as_near():
    seen = []

    def watch(batch):
        return lambda observation, *_: seen.append(observation) or np.zeros((batch, 2))

    far = np.zeros((3, FACTS.observation_dim), np.float32)
    far[0, :6] = [0.5, -0.5, 0.1, 0.2, 1.0, -1.0]
    far[1, :6] = [3.0, -3.0, 0.1, 0.2, 3.0, -4.0]
    familiar(watch)(3)(far, None, None)
    assert np.array_equal(seen[0][[0, 2]], far[[0, 2]])
    near = 0.2 * FARTHEST_GOAL_M
    assert seen[0][1, :6] == pytest.approx([1.0, -1.0, 0.1, 0.2, 3.0 * near, -4.0 * near])


def test_rows_resume_and_hold_what_was_measured(tmp_path, monkeypatch, capsys):
    few = [("a few", [Team(robots=2), Team(robots=3, mixed=True, familiar=True)])]
    monkeypatch.setattr(team_size_command, "teams", lambda: few)
    path = tmp_path / "rows.json"
    asked = ["--episodes", "3", "--seeds", "1", "--json", str(path)]
    assert team_size_command.main(asked) == 0
    rows = read_result(path, list[TeamRow])
    assert [row.team for row in rows] == few[0][1]
    assert all(row.success + sum(row.failures.values()) == pytest.approx(100.0) for row in rows)
    assert all(row.success <= row.at_goal <= 100.0 and row.tick_us > 0.0 for row in rows)
    path.write_bytes(msgspec.json.encode([msgspec.structs.replace(rows[0], success=12.3)]))
    assert team_size_command.main(asked) == 0
    assert [row.success for row in read_result(path, list[TeamRow])] == [12.3, rows[1].success]
    assert "| 2 robots | 12.3 |" in capsys.readouterr().out
