"""Teams that are guided while they explore, against the robots' own correction."""

import numpy as np
import pytest
import torch

from export.episodes.judges import motion
from export.scenarios import make_scenario
from export.values.guided_teams import SHARE, GuidedTeams

TEAMS = 32
CPU = torch.device("cpu")


@pytest.fixture(params=["navigation", "balance", "sampling"])
def teams(request):
    return GuidedTeams(make_scenario(request.param, TEAMS, 0, CPU, training=True), 5)


def explored(teams, steps=3):
    draw = torch.Generator().manual_seed(0)
    shape = (TEAMS, teams.facts.robots, 2)
    for _ in range(steps):
        action = 0.5 * torch.randn(shape, generator=draw)
        teams.step(action)
    return action.double().numpy()


def test_guided_teams_are_corrected_and_the_others_let_alone(teams):
    action = explored(teams)
    low, high = ([getattr(field, end) for field in teams.facts.action] for end in ("low", "high"))
    wanted = np.clip(action, low, high)
    guided = int(SHARE * TEAMS)
    assert np.array_equal(teams.commanded[guided:], wanted[guided:])
    moved = np.abs(teams.commanded[:guided] - wanted[:guided]).max((1, 2))
    assert moved.max() > 0.01


def test_the_world_moves_as_commanded(teams):
    other = make_scenario(teams.facts.name, TEAMS, 0, CPU, training=True)
    other.load_state_dict(teams.scenario.state_dict())
    explored(teams, steps=1)
    other.step(torch.from_numpy(teams.commanded).float())
    for own, there in zip(motion(teams.scenario), motion(other), strict=True):
        assert np.array_equal(own, there)


def test_a_new_episode_begins_without_a_last_command(teams):
    explored(teams)
    begun = torch.arange(TEAMS) % 2 == 0
    teams.reset(begun)
    assert not teams.commanded[begun.numpy()].any()
    assert teams.commanded[~begun.numpy()].any()
