"""Requirements that bind at once: what correcting an action in several steps promises."""

import itertools
from typing import ClassVar

import numpy as np
import pytest
from guidance_cases import DYNAMICS, UNIT, Quadratic, gaussian_flow, guide_for, random_team
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_models import EXAMPLES
from networks import random_weights

from edge_runtime.common.vectors import plus
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.projection import cone
from edge_runtime.guidance.slopes import action_slope
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.objectives import Geofence, Objective, SafetyMargin, Slope, SpeedLimit
from edge_runtime.policy.numpy_policy import FlowPolicy

REST = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0)))
ASKED = [
    SpeedLimit(limit_m_s=0.2),
    SafetyMargin(distance_m=0.4),
    Geofence(centre_m=(0.1, 0.0), radius_m=0.3),
    SafetyMargin(distance_m=0.6, look_ahead=6),
    SpeedLimit(limit_m_s=0.1, look_ahead=4),
]
angles = st.floats(0.0, 6.28)


class HalfPlane(Objective, frozen=True, kw_only=True, tag="half_plane"):
    """J = 1/2 (what is missing to ``least`` along a direction)^2, over actions: see `UNIT`."""

    angle: float
    least: float
    preference: ClassVar[bool] = False

    def evaluate(self, motion, outlook):
        x, y = np.cos(self.angle), np.sin(self.angle)
        missing = max(self.least - float(x * motion.x + y * motion.y), 0.0)
        return Slope(0.5 * missing**2, -missing * float(x), -missing * float(y))


def costs_after(objectives, seed, steps, teammates=3):
    """Each requirement's cost of the action that so many steps at most lead to."""
    draw = np.random.default_rng(seed)
    team, observation = random_team(draw, teammates), draw.standard_normal((1, 18)).astype(np.float32)
    guide = guide_for(objectives, mode="correction", requirement_steps=steps)
    action = guided_action(FlowPolicy(random_weights(seed=4), 3), observation, team, guide).action
    return [
        action_slope(each, guide.outlook(place, team, ()), action)[0]
        for place, each in enumerate(guide.objectives)
    ]


@pytest.mark.parametrize("chosen", [(0, 1), (1, 0), (0, 2, 1), (0, 1, 2, 3, 4)])
def test_more_steps_never_do_worse(chosen):
    """Cut short after any step, as a smaller number does, the sum of costs has not risen."""
    better = 0
    for seed in range(60):
        sums = [sum(costs_after([ASKED[m] for m in chosen], seed, steps)) for steps in range(1, 7)]
        assert all(after <= before for before, after in itertools.pairwise(sums))
        better += sums[4] < 0.5 * sums[0]
    assert better


def in_corner(first, second, start, **changes):
    """Where the correction of a flow that ends at ``start`` leads."""
    guide = guide_for([first, second], UNIT, mode="correction", **changes)
    flow = gaussian_flow(0.5, np.array(start), 4)
    return np.array(guided_action(flow, np.zeros((1, 1), np.float32), REST, guide).action)


@settings(max_examples=80, deadline=None)
@given(
    angle=angles,
    apart=st.floats(0.3, 2.8),
    least=st.tuples(st.floats(0.1, 1.0), st.floats(0.1, 1.0)),
)
def test_two_linear_requirements_are_both_met_however_they_oppose(angle, apart, least):
    """In closed form where they oppose each other: the corner of their boundaries."""
    planes = [HalfPlane(angle=angle, least=least[0]), HalfPlane(angle=angle + apart, least=least[1])]
    found = in_corner(*planes, (0.0, 0.0))
    rows = np.array([[np.cos(each.angle), np.sin(each.angle)] for each in planes])
    assert (rows @ found >= np.array(least) - 1e-8).all()
    if np.cos(apart) < -1e-3:  # projecting onto one alone never meets the other
        assert found == pytest.approx(np.linalg.solve(rows, least), abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(angle=angles, least=st.floats(0.1, 1.0))
def test_what_cannot_be_had_does_not_stand_in_the_way_of_what_can(angle, least):
    """Two that oppose each other are left as they were; a third beside them is met."""
    opposed = [HalfPlane(angle=angle + side, least=2.0) for side in (0.0, np.pi)]
    third = HalfPlane(angle=angle + np.pi / 2, least=least)
    guide = guide_for([*opposed, third], UNIT, mode="correction")
    flow = gaussian_flow(0.5, np.zeros(2), 4)
    action = guided_action(flow, np.zeros((1, 1), np.float32), REST, guide).action
    assert np.dot(action, [np.cos(third.angle), np.sin(third.angle)]) >= least - 1e-8


def test_a_margin_that_is_barely_broken_does_not_forbid_braking():
    """A teammate ahead to the left, passed 0.1 mm too near: braking opposes the push away from it."""
    mate = Teammate(RobotState(1, 0.0, (-0.138, -0.15), (0.0, 0.0)))
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.29, 0.0)), (mate,))
    speed, margin = SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)
    guide = guide_for([speed, margin], DYNAMICS, mode="correction")
    flow = gaussian_flow(0.5, np.array([1.0, -0.5]), 4)
    result = guided_action(flow, np.zeros((1, 1), np.float32), team, guide)
    after = [action_slope(guide.objectives[m], guide.outlook(m, team, ()), result.action) for m in (0, 1)]
    assert min(result.costs) > 0.0
    assert max(cost for cost, _ in after) < 1e-5


@pytest.mark.parametrize("chosen", [(0,), (0, 1), (0, 1, 2, 3, 4)])
def test_one_step_is_the_cones_whatever_comes_of_it(chosen):
    """As logs of earlier versions have it: they replay bit for bit."""
    asked = [ASKED[m] for m in chosen]
    guide, unguided = guide_for(asked, mode="correction", requirement_steps=1), guide_for([])
    policy = FlowPolicy(random_weights(seed=4), 3)
    for seed in range(20):
        draw = np.random.default_rng(seed)
        team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
        sampled = guided_action(policy, observation, team, unguided).action
        slopes = [
            action_slope(each, guide.outlook(place, team, ()), sampled)
            for place, each in enumerate(guide.objectives)
        ]
        directions = [tuple([-g for g in gradient]) for _, gradient in slopes]
        step = cone(directions, (1.0,) * len(directions), (0.0, 0.0))
        result = guided_action(policy, observation, team, guide)
        assert result.action == plus(sampled, 1.0, step)
        assert result.costs == tuple(cost for cost, _ in slopes)


@pytest.mark.parametrize("name", EXAMPLES)
def test_only_bases_whose_motion_is_linear_in_the_action_take_more_than_one(name):
    guide = guide_for([SafetyMargin(distance_m=0.5)], EXAMPLES[name], requirement_steps=4)
    assert guide.steering.steps == (1 if "unicycle" in name else 4)


def test_one_requirement_alone_is_met_by_one_newton_step():
    goal = (0.3, -0.7)
    guide = guide_for([Quadratic(goal=goal)], UNIT, mode="correction")
    flow = gaussian_flow(0.5, np.array([1.0, 0.5]), 4)
    result = guided_action(flow, np.zeros((1, 1), np.float32), REST, guide)
    assert result.action == pytest.approx(goal, abs=1e-12)
    assert result.costs[0] > 0.1
