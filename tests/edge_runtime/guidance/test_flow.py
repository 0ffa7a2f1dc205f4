"""Guided sampling: batch against single, Theorem 1 in closed form, anytime behaviour and faults."""

import itertools
import math
import time
from typing import ClassVar

import numpy as np
import pytest
import scipy.integrate
from guidance_cases import (
    DYNAMICS,
    OBJECTIVES,
    UNIT,
    Quadratic,
    gaussian_flow,
    guide_for,
    random_team,
)
from networks import random_weights

from edge_runtime.errors import PolicyError
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.objectives import (
    Objective,
    SafetyMargin,
    Slope,
    SpeedLimit,
)
from edge_runtime.policy.flow_steps import SAMPLERS, flow_steps
from edge_runtime.policy.numpy_policy import FlowPolicy


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("scale", [0.0, 0.5, 3.0])
def test_theorem_1_closed_form(scale, sampler):
    """The guided field descends the regularised objective of eq. 13, exactly, for a Gaussian flow.

    For this flow v = mean-shift terms + gain (a - tau m), the score of p_tau is
    -(a - tau m) / var_tau, and v = (a + (1 - tau) score) / tau. Eq. 12 must then move along
    v - eta A^T (a_hat - goal) with A = 1 + (1 - tau) gain, whose linear ODE has a known solution.
    """
    std, mean, goal, steps = 0.5, np.array([0.3, -0.2]), np.array([1.0, 0.5]), 4000
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0)))
    objective = Quadratic(goal=tuple(goal.tolist()))
    guide = guide_for([objective], UNIT, mode="none", scale=scale)
    start = np.array([0.4, -1.0])
    result = guided_action(
        gaussian_flow(std, mean, steps, sampler), np.zeros((1, 1), np.float32), team, guide, tuple(start)
    )

    # For the deviation x = a - tau m the whole equation is linear.
    def field(tau, x):
        variance = (1 - tau) ** 2 + tau**2 * std**2
        estimator = tau * std**2 / variance  # cov(a_1, a_tau) / var(a_tau): the posterior mean's slope
        score_part = x / tau * (1 - (1 - tau) / variance) if tau > 1e-9 else -x
        return score_part - scale * estimator * (estimator * x + mean - goal)

    exact = scipy.integrate.solve_ivp(field, (0, 1), start, rtol=1e-10, atol=1e-12, max_step=0.001)
    assert np.allclose(result.action, exact.y[:, -1] + mean, atol=2e-3)
    if scale == 0.0:
        assert np.allclose(result.action, mean + std * start, atol=2e-3)


def test_theorem_1_guidance_trades_cost_against_likelihood():
    """More guidance means lower cost and lower likelihood under the unguided flow."""
    std, mean, goal = 0.5, np.zeros(2), 2.0
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0)))
    observation = np.zeros((1, 1), np.float32)
    ends = []
    for scale in (0.0, 0.25, 0.5, 1.0, 2.0):
        guide = guide_for([Quadratic(goal=(goal, 0.0))], UNIT, mode="none", scale=scale)
        ends.append(guided_action(gaussian_flow(std, mean, 200), observation, team, guide).action[0])
    assert ends[0] == pytest.approx(0.0, abs=1e-9)
    costs, distances = [(end - goal) ** 2 for end in ends], np.abs(ends)
    assert all(a > b for a, b in itertools.pairwise(costs))
    assert all(a < b for a, b in itertools.pairwise(distances))


def test_a_late_tick_returns_the_newest_estimate():
    weights, draw = random_weights(), np.random.default_rng(0)
    team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
    guide = guide_for(OBJECTIVES[:2], mode="cone", scale=1.0)
    policy = FlowPolicy(weights, 10)
    late = guided_action(policy, observation, team, guide, deadline_s=time.monotonic() - 1.0)
    assert late.steps == 1
    assert not late.fault
    one_step = guided_action(
        FlowPolicy(weights, 1),
        observation,
        team,
        guide_for(OBJECTIVES[:2], mode="cone", scale=0.1),
    )
    # At tau = 0 the estimate plus a tenth of the guidance is one Euler step at a tenth of the scale.
    assert late.action == pytest.approx(one_step.action, abs=1e-6)
    assert guided_action(policy, observation, team, guide, deadline_s=math.inf).steps == 10


@pytest.mark.parametrize("scale", [0.01, 1.0, 10.0])
@pytest.mark.parametrize("other_weight", [0.0, 20.0])
def test_the_terminal_correction_brakes_whatever_scale_and_weights(scale, other_weight):
    """Where eq. 15 leaves a robot speeding, the correction at tau = 1 meets the limit exactly."""
    draw, limit = np.random.default_rng(3), SpeedLimit(limit_m_s=0.2, buffer_m_s=0.01)
    objectives = [limit, SafetyMargin(distance_m=1e-3, buffer_m=0.0, weight=other_weight)]
    policy, preview = FlowPolicy(random_weights(seed=4), 10), DYNAMICS.preview(1)
    speeding = 0
    for _ in range(50):
        team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)

        def next_speed(mode, team=team, observation=observation):
            guide = guide_for(objectives, mode=mode, scale=scale)
            action = guided_action(policy, observation, team, guide).action
            return np.linalg.norm(
                preview.velocity_decay * np.array(team.own.velocity_m_s)
                + preview.velocity_gain * np.array(action)
            )

        speeding += next_speed("hierarchical") > limit.limit_m_s
        assert next_speed("terminal") <= limit.limit_m_s - limit.buffer_m_s + 1e-9
    assert speeding > 0


def test_the_terminal_correction_leaves_kept_objectives_alone():
    draw = np.random.default_rng(3)
    policy, team = FlowPolicy(random_weights(), 10), random_team(draw)
    observation, kept = draw.standard_normal((1, 18)).astype(np.float32), [SpeedLimit(limit_m_s=50.0)]
    actions = [
        guided_action(policy, observation, team, guide_for(kept, mode=mode)).action
        for mode in ("none", "terminal")
    ]
    assert actions[0] == actions[1]


class Faulty(Objective, frozen=True, kw_only=True, tag="faulty"):
    bad: str = "nan"

    def evaluate(self, motion, outlook):
        return Slope(0.0, d_x=float(self.bad))


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf"])
def test_non_finite_inputs_are_faults(bad):
    team, policy = random_team(np.random.default_rng(1)), FlowPolicy(random_weights(), 5)
    clean = np.zeros((1, 18), np.float32)
    poisoned = clean.copy()
    poisoned[0, 4] = float(bad)
    unguided = guide_for(())
    assert "observation" in guided_action(policy, poisoned, team, unguided).fault
    result = guided_action(policy, clean, team, guide_for([SpeedLimit(limit_m_s=1.0), Faulty(bad=bad)]))
    assert "faulty" in result.fault
    assert result.action == (0.0, 0.0)


class Raising(Objective, frozen=True, kw_only=True, tag="raising"):
    """Fails in its ``after``-th call."""

    after: int = 0
    asked: ClassVar[list[int]] = []

    def evaluate(self, motion, outlook):
        self.asked.append(0)
        return Slope(0.0) if len(self.asked) <= self.after else 1 / 0


class Wordless(Objective, frozen=True, kw_only=True, tag="wordless"):
    def evaluate(self, motion, outlook):
        return None


@pytest.mark.parametrize(
    ("objective", "steps", "fault"),
    [
        (Raising(), 0, "objective raising raised ZeroDivisionError: division by zero"),
        (Raising(after=3), 3, "objective raising raised ZeroDivisionError: division by zero"),
        (Raising(after=5), 5, "objective raising raised ZeroDivisionError: division by zero"),
        (Wordless(), 0, "objective wordless raised TypeError: cannot unpack"),
    ],
    ids=["at once", "on the way", "in the correction", "no slope"],
)
def test_an_objective_that_raises_is_named(objective, steps, fault):
    Raising.asked.clear()
    team, policy = random_team(np.random.default_rng(1)), FlowPolicy(random_weights(), 5)
    guide = guide_for([SpeedLimit(limit_m_s=0.1), objective])
    result = guided_action(policy, np.zeros((1, 18), np.float32), team, guide)
    assert (result.action, result.steps) == ((0.0, 0.0), steps)
    assert result.fault.startswith(fault)


class Broken:
    """A policy that fails, whole or step by step."""

    backend, batch, action_dim, observation_dim = "broken", 1, 2, 18
    schedule = flow_steps("euler", 5, None)
    sampler = None

    def observe(self, observation):
        pass

    def step(self, k, action):
        raise PolicyError("the graph cannot be computed")

    def knows(self, steering):
        return True

    def velocity(self, k, action):
        raise PolicyError("the graph cannot be computed")

    def sample(self, *arguments):
        raise PolicyError("the kernel cannot sample")


@pytest.mark.parametrize(("whole", "problem"), [(False, "graph"), (True, "kernel")])
def test_a_policy_that_fails_is_no_objectives_fault(whole, problem):
    team, policy = random_team(np.random.default_rng(1)), Broken()
    policy.sampler = policy if whole else None
    with pytest.raises(PolicyError, match=problem):
        guided_action(policy, np.zeros((1, 18), np.float32), team, guide_for([SpeedLimit(limit_m_s=0.1)]))


class FaultyAtTheEnd(Objective, frozen=True, kw_only=True, tag="faulty_at_the_end"):
    """Its gradient fails in the correction only, after a single Euler step."""

    asked: ClassVar[list[int]] = []

    def evaluate(self, motion, outlook):
        self.asked.append(0)
        return Slope(0.0, d_x=math.nan if len(self.asked) > 1 else 0.0)


class FaultyWishAtTheEnd(FaultyAtTheEnd, frozen=True, kw_only=True, tag="faulty_wish_at_the_end"):
    preference: ClassVar[bool] = True


@pytest.mark.parametrize("kind", [FaultyAtTheEnd, FaultyWishAtTheEnd])
def test_a_gradient_that_fails_in_the_correction_is_a_fault(kind):
    FaultyAtTheEnd.asked.clear()
    team, policy = random_team(np.random.default_rng(1)), FlowPolicy(random_weights(), 1)
    guide = guide_for([SpeedLimit(limit_m_s=0.1), kind()])
    result = guided_action(policy, np.zeros((1, 18), np.float32), team, guide)
    assert (result.action, result.steps) == ((0.0, 0.0), 1)
    assert result.fault == f"the gradient of {kind().name} is not finite"


def test_a_non_finite_velocity_is_a_fault():
    weights = random_weights()
    weights.biases[-1][0] = np.nan
    team = random_team(np.random.default_rng(1))
    result = guided_action(FlowPolicy(weights, 5), np.zeros((1, 18), np.float32), team, guide_for(()))
    assert "velocity" in result.fault


def test_without_scale_or_weight_the_flow_is_unguided():
    draw = np.random.default_rng(7)
    team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
    policy = FlowPolicy(random_weights(), 10)
    unguided = guided_action(policy, observation, team, guide_for(()))
    for settings, objectives in [
        (GuidanceSettings(scale=0.0), OBJECTIVES),
        (GuidanceSettings(), [SpeedLimit(limit_m_s=0.1, weight=0.0)]),
    ]:
        assert (
            guided_action(policy, observation, team, make_guide(ObjectiveSet(objectives, settings), DYNAMICS))
            == unguided
        )


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": math.inf},
        {"scale": -1.0},
        {"start_noise": math.nan},
        {"reach": -0.1},
        {"reach": math.inf},
        {"goal_reach": -0.1},
        {"goal_reach": math.nan},
        {"goal_within_m": math.inf},
    ],
)
def test_bad_settings_are_refused(wrong):
    with pytest.raises(ValueError, match="finite and not negative"):
        GuidanceSettings(**wrong)


@pytest.mark.parametrize("steps", [0, -1, 101])
def test_requirements_take_one_step_or_some_more(steps):
    with pytest.raises(ValueError, match=r"`requirement_steps` must lie in \[1, 100\], got "):
        GuidanceSettings(requirement_steps=steps)


def head_on(mode, *objectives):
    """A robot that drives east at 0.5 m/s towards a teammate 0.2 m ahead, its flow at rest."""
    mate = Teammate(RobotState(1, 0.0, (0.2, 0.0), (0.0, 0.0)))
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.5, 0.0)), (mate,))
    guide = guide_for(objectives, mode=mode, scale=1.0)
    flow = gaussian_flow(0.5, np.zeros(2), 4)
    return guided_action(flow, np.zeros((1, 1), np.float32), team, guide)


class GoEast(Objective, frozen=True, kw_only=True, tag="go_east"):
    def evaluate(self, motion, outlook):
        return Slope(1.0, d_vx=-1.0)


def test_conflicts_are_counted_for_the_objectives_that_have_them():
    """Braking before a teammate opposes whoever wants to go on, not who agrees.

    In each of four steps but the first: at tau = 0 this flow leads from anywhere to the same end.
    """
    margin, speed = SafetyMargin(distance_m=0.5), SpeedLimit(limit_m_s=0.1)
    for mode in ("none", "hierarchical", "cone"):
        assert head_on(mode, margin, speed).conflicts == (0, 0)
        assert head_on(mode, margin, GoEast()).conflicts == (3, 3)
        assert head_on(mode, margin, speed, GoEast()).conflicts == (3, 3, 6)
    assert head_on("none", margin, GoEast()).projections == 0
    assert head_on("cone", margin, GoEast()).projections == 3


def test_only_mode_terminal_corrects_and_only_eq_15_says_what_it_removed():
    speed = SpeedLimit(limit_m_s=0.1)
    plain, paper, terminal = (head_on(mode, speed) for mode in ("none", "hierarchical", "terminal"))
    assert plain.correction == paper.correction == (0.0, 0.0)
    assert terminal.correction[0] < 0.0
    assert terminal.action == (paper.action[0] + terminal.correction[0], paper.action[1])
    assert plain.opposed == 0
    # The first braking meets a flow at rest; then the flow pulls back, and braking opposes it.
    assert paper.opposed == paper.projections == 2
