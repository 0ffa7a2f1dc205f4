"""Guided sampling of B robots against one robot's."""

from typing import get_args

import numpy as np
import pytest
from guidance_cases import OBJECTIVES, WISHES, guide_for, random_team
from motion_models import EXAMPLES
from msgspec.structs import replace
from networks import random_weights
from team_batches import as_batch

from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.settings import Mode
from edge_runtime.messages import TrackedObject
from edge_runtime.objectives import Geofence, Passing, SpeedLimit, TrackedMargin
from edge_runtime.policy.flow_steps import SAMPLERS
from edge_runtime.policy.numpy_policy import FlowPolicy
from export.evaluation.guidance import Worth, guided_actions


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("mode", get_args(Mode))
@pytest.mark.parametrize(
    "objectives",
    [
        OBJECTIVES[:3],
        WISHES,
        [WISHES[0], OBJECTIVES[0], WISHES[1], Passing(order=(2, 0, 3, 1), reach_m=0.5), OBJECTIVES[1]],
    ],
    ids=["requirements", "preferences", "both"],
)
def test_batch_and_single_agree(make_backend, mode, objectives, sampler):
    draw = np.random.default_rng(5)
    weights = random_weights(seed=2)
    teams = [random_team(draw) for _ in range(40)]
    observations = draw.standard_normal((40, 18)).astype(np.float32)
    starts = draw.standard_normal((40, 2))
    guide = guide_for(objectives, mode=mode, scale=2.0, reach=0.3)
    policy = make_backend(weights, 10, 40, sampler=sampler)
    many = guided_actions(policy, observations, as_batch(teams), guide, starts)
    policy = FlowPolicy(weights, 10, sampler=sampler)
    for i, team in enumerate(teams):
        one = guided_action(policy, observations[i : i + 1], team, guide, tuple(starts[i].tolist()))
        assert np.abs(many[i] - one.action).max() <= 2e-5 * max(1.0, np.abs(many[i]).max())


def door(draw, dims):
    place, velocity = draw.uniform(-0.5, 0.5, (2, dims)).tolist()
    return TrackedObject("door", 0.0, tuple(place), tuple(velocity), goal_m=(0.0,) * dims)


@pytest.mark.parametrize("name", [name for name, model in EXAMPLES.items() if model.action_dim <= 4])
def test_a_batch_of_any_model_is_its_robots_one_by_one(make_backend, name):
    model, draw = EXAMPLES[name], np.random.default_rng(6)
    asked = [*OBJECTIVES[:2], *WISHES, Geofence(centre_m=(0.1, 0.0), radius_m=0.3)]
    asked += [TrackedMargin(object=name, distance_m=0.4) for name in ("door", "ghost")]
    followed = [each for each in asked if not each.refuses(model)]
    weights, teams = (
        random_weights(action_dim=model.action_dim),
        [replace(random_team(draw, model=model), tracked=(door(draw, model.dims),)) for _ in range(5)],
    )
    observations, starts = (
        draw.standard_normal((5, 18)).astype(np.float32),
        draw.standard_normal((5, model.action_dim)),
    )
    middle_m = float(np.median(as_batch(teams).left_m))  # where some of them have arrived
    guide = guide_for(followed, model, scale=1.0, goal_reach=3.0, goal_within_m=middle_m)
    many = guided_actions(make_backend(weights, 4, 5), observations, as_batch(teams), guide, starts)
    policy = make_backend(weights, 4)
    for i, team in enumerate(teams):
        one = guided_action(policy, observations[i : i + 1], team, guide, tuple(starts[i].tolist()))
        np.testing.assert_allclose(many[i], one.action, rtol=2e-5, atol=2e-5)


def test_one_row_that_is_not_finite_leaves_the_others_alone(make_backend):
    draw = np.random.default_rng(7)
    teams = as_batch([random_team(draw) for _ in range(3)])
    observations, starts = draw.standard_normal((3, 18)).astype(np.float32), np.zeros((3, 2))
    policy, guide = make_backend(random_weights(), 4, 3), guide_for(OBJECTIVES)
    right = guided_actions(policy, observations, teams, guide, starts)
    teams.own.velocity_m_s[1] = np.nan
    wrong = guided_actions(policy, observations, teams, guide, starts)
    assert np.isnan(wrong[1]).all()
    np.testing.assert_array_equal(wrong[[0, 2]], right[[0, 2]])


def sampled_teams(draw, count=20):
    """Policy, observations, teams and starts of so many robots."""
    policy = FlowPolicy(random_weights(), 4, count)
    observations = draw.standard_normal((count, 18)).astype(np.float32)
    teams = as_batch([random_team(draw) for _ in range(count)])
    return policy, observations, teams, draw.standard_normal((count, 2))


def uphill(action):
    """Slopes of what is worth most at the origin."""
    return -action


def test_what_is_worth_most_is_gone_to_within_reach():
    policy, *seen = sampled_teams(np.random.default_rng(8))
    guide = guide_for([SpeedLimit(limit_m_s=100.0)], mode="correction", reach=0.4)
    observations, teams, starts = seen
    plain = guided_actions(policy, observations, teams, guide, starts)
    length = np.linalg.norm(plain, axis=1, keepdims=True)
    assert (length < 0.4).any()
    assert (length > 0.4).any()
    first = guided_actions(policy, observations, teams, guide, starts, worth=Worth(uphill, first=True))
    np.testing.assert_allclose(first, plain * np.maximum(0.0, 1.0 - 0.4 / length), atol=1e-12)
    against = guided_actions(policy, observations, teams, guide, starts, worth=Worth(uphill, first=False))
    moved = np.linalg.norm(against - plain, axis=1, keepdims=True)
    assert (moved <= 0.4 + 1e-12).all()
    assert (np.linalg.norm(against, axis=1, keepdims=True) <= length + 1e-12).all()
    assert (moved > 0.5 * np.minimum(length, 0.4)).all()


def test_preferences_that_come_after_what_is_worth_most_still_have_their_reach():
    policy, observations, teams, starts = sampled_teams(np.random.default_rng(9))
    guide = guide_for(WISHES, mode="correction", reach=0.2)
    alone = replace(guide, preferences=(), requirements=())
    worth = Worth(uphill, first=True)
    begun = guided_actions(policy, observations, teams, alone, starts, worth=worth)
    wished = guided_actions(policy, observations, teams, guide, starts, worth=worth)
    moved = np.linalg.norm(wished - begun, axis=1)
    assert (moved <= 0.2 + 1e-12).all()
    assert moved.max() > 0.1
