"""Guided actions agree with an independent autograd computation of eqs. 10 to 15."""

import itertools
from functools import partial
from typing import get_args

import numpy as np
import pytest
from guidance_cases import DYNAMICS, OBJECTIVES, guide_for, random_team
from networks import random_weights

from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.settings import Mode
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.objectives import SafetyMargin, Spacing, SpatialOrder, SpeedLimit
from edge_runtime.policy.flow_steps import SAMPLERS
from edge_runtime.policy.numpy_policy import FlowPolicy

torch = pytest.importorskip("torch")
import torch_oracle  # noqa: E402

COSTS = {
    "speed_limit": torch_oracle.speed_cost,
    "safety_margin": torch_oracle.margin_cost,
    "spacing": torch_oracle.spacing_cost,
    "spatial_order": torch_oracle.order_cost,
}
MIXED = [
    SpatialOrder(order=(2, 0, 3, 1), gap_m=0.2, weight=0.7),
    SpeedLimit(limit_m_s=0.3),
    Spacing(distance_m=0.3, weight=0.4),
    SafetyMargin(distance_m=0.5),
]
CASES = list(itertools.product(["silu", "tanh"], [1, 2, 3, 4], [1, 2, 5, 10, 20], get_args(Mode), SAMPLERS))


@pytest.mark.parametrize(("activation", "count", "steps", "mode", "sampler"), CASES)
def test_guided_actions_agree_with_autograd(activation, count, steps, mode, sampler):
    seed = CASES.index((activation, count, steps, mode, sampler))
    draw = np.random.default_rng(seed)
    weights = random_weights(seed=seed, activation=activation, prior_std=[None, 0.5, 0.2][seed % 3])
    objectives = OBJECTIVES[:count]
    policy = FlowPolicy(weights, steps, sampler=sampler)
    guide = guide_for(objectives, mode=mode, scale=1.0)
    for _ in range(3):
        team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
        start = tuple(draw.standard_normal(2).tolist())
        costs = [partial(COSTS[o.name], o, team, DYNAMICS) for o in objectives]
        expected = torch_oracle.guided_action(
            weights,
            observation[0],
            costs,
            [o.weight for o in objectives],
            1.0,
            mode,
            start,
            steps,
            sampler=sampler,
        )
        result = guided_action(policy, observation, team, guide, start)
        assert result.steps == steps
        assert not result.fault
        assert np.abs(result.action - expected).max() <= 1e-5 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("steps", [1, 10])
@pytest.mark.parametrize("reach", [0.0, 0.1, 0.5, 20.0])
@pytest.mark.parametrize("chosen", [(0,), (2,), (0, 2), (0, 1), (2, 3), (0, 1, 2, 3)])
def test_preferences_before_requirements_agree_with_autograd(chosen, reach, steps):
    draw = np.random.default_rng([*chosen, steps])
    weights, objectives = random_weights(seed=sum(chosen)), [MIXED[m] for m in chosen]
    wishes = [m for m, place in enumerate(chosen) if place in (0, 2)]
    guide = guide_for(objectives, scale=1.0, reach=reach)
    for _ in range(5):
        team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
        costs = [partial(COSTS[o.name], o, team, DYNAMICS) for o in objectives]
        lambdas = [o.weight for o in objectives]
        expected = torch_oracle.guided_action(
            weights, observation[0], costs, lambdas, 1.0, "terminal", (0.3, -0.2), steps, wishes, reach
        )
        result = guided_action(FlowPolicy(weights, steps), observation, team, guide, (0.3, -0.2))
        assert np.abs(result.action - expected).max() <= 1e-5


def test_the_oracle_sees_what_it_claims():
    """The oracle's own gradient of a cost, once by hand: speed 0.5 along x, limit 0.3."""
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.5 / 0.75, 0.0)))
    action = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    objective = SpeedLimit(limit_m_s=0.3, buffer_m_s=0.0)
    torch_oracle.speed_cost(objective, team, DYNAMICS, action).backward()
    assert action.grad.numpy() == pytest.approx([0.2 / 0.1, 0.0])
