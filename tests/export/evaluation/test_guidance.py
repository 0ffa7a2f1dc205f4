"""Guided sampling of B robots against one robot's."""

from typing import get_args

import numpy as np
import pytest
from guidance_cases import OBJECTIVES, WISHES, guide_for, random_team
from networks import random_weights
from team_batches import as_batch

from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.settings import Mode
from edge_runtime.objectives import Passing
from edge_runtime.policy.flow_steps import SAMPLERS
from edge_runtime.policy.numpy_policy import FlowPolicy
from export.evaluation.guidance import guided_actions


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
def test_batch_and_single_agree(mode, objectives, sampler):
    draw = np.random.default_rng(5)
    weights = random_weights(seed=2)
    teams = [random_team(draw) for _ in range(40)]
    observations = draw.standard_normal((40, 18)).astype(np.float32)
    starts = draw.standard_normal((40, 2))
    guide = guide_for(objectives, mode=mode, scale=2.0, reach=0.3)
    many = guided_actions(FlowPolicy(weights, 10, 40, sampler), observations, as_batch(teams), guide, starts)
    policy = FlowPolicy(weights, 10, sampler=sampler)
    for i, team in enumerate(teams):
        one = guided_action(policy, observations[i : i + 1], team, guide, tuple(starts[i].tolist()))
        assert np.abs(many[i] - one.action).max() <= 2e-5 * max(1.0, np.abs(many[i]).max())
