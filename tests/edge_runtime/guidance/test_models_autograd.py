"""Guided actions of every motion model, of one to six components, agree with autograd of its roll-outs."""

from functools import partial
from typing import get_args

import numpy as np
import pytest
from guidance_cases import guide_for, random_team
from motion_models import EXAMPLES
from networks import ENGINES, random_weights

from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.settings import Mode
from edge_runtime.motion.unicycle import Unicycle
from edge_runtime.objectives import SafetyMargin, Spacing, SpatialOrder, SpeedLimit
from edge_runtime.policy.compiled_policy import CompiledPolicy
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.velocity_field import PYTHON

torch = pytest.importorskip("torch")
import torch_oracle  # noqa: E402

REQUIRED = [
    (SpeedLimit(limit_m_s=0.2, look_ahead=2), torch_oracle.speed_cost),
    (SafetyMargin(distance_m=0.6, weight=0.5), torch_oracle.margin_cost),
    (SafetyMargin(distance_m=0.9, look_ahead=6, weight=0.2), torch_oracle.margin_cost),
]
WISHED = [
    (SpatialOrder(order=(2, 0, 3, 1), gap_m=0.2, weight=0.7), torch_oracle.order_cost),
    (Spacing(distance_m=0.3, weight=0.4), torch_oracle.spacing_cost),
]
STEPS = 5
BACKENDS = [FlowPolicy, *(partial(CompiledPolicy, engine=engine) for engine in ENGINES)]


def compared(model, cases, mode, backends):
    """The largest difference between what backends sample and what the oracle does, in some teams."""
    objectives, d = [objective for objective, _ in cases], model.action_dim
    draw = np.random.default_rng([d, len(cases)])
    weights = random_weights(seed=d, action_dim=d)
    guide = guide_for(objectives, model, mode=mode, scale=1.0, reach=0.3)
    wishes = [m for m, objective in enumerate(objectives) if objective.preference]
    policies, worst, active = [backend(weights, STEPS) for backend in backends], 0.0, 0
    for _ in range(3):
        team, observation = random_team(draw, model=model), draw.standard_normal((1, 18)).astype(np.float32)
        start = tuple(draw.standard_normal(d).tolist())
        expected = torch_oracle.guided_action(
            weights,
            observation[0],
            [partial(cost, objective, team, model) for objective, cost in cases],
            [objective.weight for objective in objectives],
            1.0,
            mode,
            start,
            STEPS,
            wishes,
            0.3,
            most=1 if isinstance(model, Unicycle) else 5,
        )
        for policy in policies:
            found = guided_action(policy, observation, team, guide, start)
            assert not found.fault
            assert found.steps == STEPS
            active += any(found.costs)
            worst = max(worst, np.abs(found.action - expected).max() / max(1.0, np.abs(expected).max()))
    assert active
    return worst


@pytest.mark.parametrize("mode", get_args(Mode))
@pytest.mark.parametrize("name", EXAMPLES)
def test_requirements_agree_with_autograd(name, mode):
    """In Python, and in every engine of the kernel where it takes the model."""
    assert compared(EXAMPLES[name], REQUIRED, mode, BACKENDS) <= 1e-5


@pytest.mark.skipif(not ENGINES, reason="the compiled kernel was not built")
@pytest.mark.parametrize("name", ["paper", "drone", "turning drone"])
def test_the_kernels_cone_is_the_nearest_point_amid_many_demands(name):
    margins = [SafetyMargin(distance_m=0.4 + 0.1 * m, look_ahead=1 + 2 * m) for m in range(6)]
    cases = [REQUIRED[0], *((margin, torch_oracle.margin_cost) for margin in margins)]
    assert compared(EXAMPLES[name], cases, "cone", [FlowPolicy, CompiledPolicy]) <= 1e-5


@pytest.mark.parametrize("name", EXAMPLES)
def test_preferences_agree_with_autograd(name):
    assert compared(EXAMPLES[name], [*REQUIRED[:2], *WISHED], "terminal", BACKENDS) <= 1e-5


@pytest.mark.skipif(not ENGINES, reason="the compiled kernel was not built")
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_kernel_takes_models_of_up_to_four_components(name):
    model = EXAMPLES[name]
    guide = guide_for([objective for objective, _ in REQUIRED], model)
    policy = CompiledPolicy(random_weights(action_dim=model.action_dim), STEPS)
    assert policy.sampler.knows(guide.steering) == (model.action_dim <= 4)
    in_python = {term.kind for term in guide.steering.terms} == {PYTHON}
    assert in_python == isinstance(model, Unicycle)
