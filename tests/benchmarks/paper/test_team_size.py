"""Teams of other sizes: who they are, that four robots are the task's own, and that rows resume."""

import msgspec
import numpy as np
import pytest
import torch
from msgspec.structs import replace

from benchmarks.common.flags import POLICIES
from benchmarks.common.result_file import read_result
from benchmarks.paper.policies import SEEDS, find_policy
from benchmarks.paper.settings import Guided
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.team_size import team_size_command
from benchmarks.paper.team_size.measure import make_world, question, team_decider
from benchmarks.paper.team_size.teams import TRAINING_ARENA, Asked, Team, TeamRow, chapters
from benchmarks.paper.tuning import tuned_default
from edge_runtime.config.fleet import Team as FleetTeam
from edge_runtime.config.network import Robot
from edge_runtime.control.mission import adapted
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import guide_for
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.observation.border import Border
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.bundle import packaged_bundle
from export.episodes.judges import motion
from export.episodes.neighbourhood import Neighbourhood, Setting
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import ARENA_HALF_WIDTH_M, FACTS

SETTINGS = Guided(guidance=GuidanceSettings(scale=0.3, start_noise=0.0, ease_m=0.1))
MIXED = Team(robots=5, crowding=3.0, mixed=True)


def all_teams():
    return [asked.team for own in chapters().values() for asked in own]


def test_four_robots_at_the_trainings_density_are_the_task_itself():
    own = Team(robots=4)
    assert (own.half_width_m, own.steps, own.masses_kg) == (ARENA_HALF_WIDTH_M, NAVIGATION.steps, ())


def test_an_arena_has_as_many_robots_to_the_area_and_time_for_its_longest_way():
    for team in all_teams():
        area = (2.0 * team.half_width_m) ** 2
        assert team.robots / area == pytest.approx(team.crowding * 4 / (2.0 * ARENA_HALF_WIDTH_M) ** 2)
        speed = 2.0 * 2.0**0.5 * team.half_width_m / (0.1 * team.steps)
        assert speed <= 0.64 * NAVIGATION.speed_limit.limit_m_s


def test_two_to_sixteen_robots_are_measured_as_the_tables_are():
    """Ten policies, 1,000 episodes of each, the tables' ``ease_m``, and as many steps."""
    asked = {one.team: one for own in chapters().values() for one in own}
    for robots in (2, 3, 4, 6, 8, 16):
        assert asked[Team(robots=robots)] == (Team(robots=robots), SEEDS, 1000)
    policy = find_policy(POLICIES, "navigation", "mafpo-chain", 0)
    asked_for = question(Team(robots=2), 0, policy, 10).settings
    tuned, guidance = tuned_default("navigation").guidance, asked_for.guidance
    for name in ("mode", "scale", "ease_m", "requirement_steps"):
        assert getattr(guidance, name) == getattr(tuned, name)
    as_seen = question(Team(robots=2, eased=False), 0, policy, 10).settings
    assert as_seen.guidance == replace(guidance, ease_m=0.0)


@pytest.mark.parametrize(
    "team", [Team(robots=2), Team(robots=8, crowding=3.0), Team(robots=5, mixed=True)], ids=str
)
def test_a_world_holds_the_team(team):
    world = make_world(team, 4, 1)
    position, _ = world.motion()
    assert position.shape == (4, team.robots, 2)
    assert position.abs().max() <= team.half_width_m
    assert world.observe().shape == (4, team.robots, FACTS.observation_dim)


def under_way(team, settings, episodes, steps):
    """A world some steps after its starts, and what was decided in the last one."""
    world, bundle = make_world(team, episodes, 1), packaged_bundle("navigation")
    decide = team_decider(team, settings, bundle)(episodes * team.robots)
    draw = np.random.default_rng(0)
    hearing = Neighbourhood(Setting(episodes=episodes, episodes_seed=1), draw)
    action = np.zeros((episodes, team.robots, 2))
    for _ in range(steps):
        views, before = hearing.views(*motion(world), action), world.state_dict()
        seen = world.observe().flatten(0, 1).numpy()
        action = decide(seen, views, draw).clip(-1.0, 1.0).reshape(action.shape)
        world.step(torch.from_numpy(action).float())
    return world, before, views, action


@pytest.mark.parametrize("asked_of", [MIXED, Team(robots=16, near=True)], ids=["mixed", "near"])
def test_a_teams_robots_decide_as_the_runtime_does_with_mass_and_arena_in_the_fleet_file(asked_of):
    _, before, views, action = under_way(asked_of, SETTINGS, 6, 12)
    fleet = FleetTeam(training_arena=TRAINING_ARENA if asked_of.near else None)
    bundle, goals = packaged_bundle("navigation"), before["goal"].flatten(0, 1).tolist()
    asked = ObjectiveSet(TASKS["navigation"].objectives, SETTINGS.guidance)
    for row, (goal, decided) in enumerate(zip(goals, action.reshape(-1, 2), strict=True)):
        mass_kg = asked_of.masses_kg[row % asked_of.robots] if asked_of.mixed else None
        own = adapted(bundle, Robot(0, (0.0, 0.0), mass_kg=mass_kg), fleet)
        guide, policy = guide_for(own.manifest, asked), own.policy()
        team = views.row(row)
        observation = Observer(own.manifest, tuple(goal)).observe(team, ease_m=guide.ease_m)
        Border(own.manifest.observation, fleet.training_arena).clamp(observation)
        expected = np.clip(guided_action(policy, observation, team, guide).action, -1.0, 1.0)
        np.testing.assert_allclose(decided, expected, atol=1e-4)


def test_who_knows_its_mass_keeps_the_speed_limit_and_who_is_told_another_does_not():
    alone = Team(robots=3, crowding=0.2, mixed=True)  # so far apart that nothing but the limit is asked
    limit = NAVIGATION.speed_limit.limit_m_s
    fastest = {}
    for told in (True, False):
        world, *_ = under_way(replace(alone, told=told), SETTINGS, 20, 15)
        fastest[told] = world.motion()[1].norm(dim=-1).amax(0)
    assert (fastest[True] <= limit + 1e-3).all()
    assert fastest[False][0] > 1.05 * limit
    assert fastest[True][1] == pytest.approx(fastest[False][1])


def test_rows_resume_and_hold_what_was_measured(tmp_path, monkeypatch, capsys):
    teams = [Team(robots=2), Team(robots=3, mixed=True, told=False)]
    monkeypatch.setattr(team_size_command, "chapters", lambda: {"a few": [Asked(one, 2, 9) for one in teams]})
    path = tmp_path / "rows.json"
    asked = ["--episodes", "3", "--json", str(path)]
    assert team_size_command.main(asked) == 0
    rows = read_result(path, list[TeamRow])
    assert [(row.robots, row.seed, row.episodes) for row in rows] == [
        (2, 0, 3),
        (2, 1, 3),
        (3, 0, 3),
        (3, 1, 3),
    ]
    assert all(row.success + sum(row.failures.values()) == pytest.approx(100.0) for row in rows)
    assert all(row.success <= row.at_goal <= 100.0 and row.tick_us > 0.0 for row in rows)
    path.write_bytes(msgspec.json.encode([replace(rows[0], success=12.5), *rows[2:]]))
    assert team_size_command.main(asked) == 0
    again = {row.question: row.success for row in read_result(path, list[TeamRow])}
    assert again == {rows[0].question: 12.5} | {row.question: row.success for row in rows[1:]}
    mean, other = 0.5 * (12.5 + rows[1].success), rows[1].success
    assert f"| 2 robots | 2 x 3 | {mean:.1f} | 12.5, {other:.1f} |" in capsys.readouterr().out
