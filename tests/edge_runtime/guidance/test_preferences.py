"""What mode ``terminal`` promises of preferences and requirements, whatever weights and reach."""

from typing import ClassVar

import msgspec
import numpy as np
import pytest
from guidance_cases import DYNAMICS, UNIT, WISHES, Quadratic, gaussian_flow, guide_for, random_team
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import random_weights

from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.objectives import BUILT_IN, Objective, SafetyMargin, Slope, SpeedLimit
from edge_runtime.policy.numpy_policy import FlowPolicy

LIMITS = [SpeedLimit(limit_m_s=0.2, buffer_m_s=0.01), SafetyMargin(distance_m=0.5, look_ahead=3)]
seeds = st.integers(0, 10**6)
weights = st.lists(st.floats(0.01, 1000.0), min_size=len(WISHES), max_size=len(WISHES))
reaches = st.floats(0.0, 100.0)


def weighted(values):
    return [msgspec.structs.replace(o, weight=w) for o, w in zip(WISHES, values, strict=True)]


def corrected(objectives, seed, reach, teammates=3):
    """A random team, its robot's sample, and what mode ``terminal`` made of that."""
    draw = np.random.default_rng(seed)
    team, observation = random_team(draw, teammates), draw.standard_normal((1, 18)).astype(np.float32)
    policy, sampled = FlowPolicy(random_weights(seed=4), 10), []
    for mode in ("hierarchical", "terminal"):
        guide = guide_for(objectives, mode=mode, scale=1.0, reach=reach)
        sampled.append(guided_action(policy, observation, team, guide))
    before, after = (np.array(sample.action) for sample in sampled)
    assert not sampled[1].fault
    assert after - before == pytest.approx(np.array(sampled[1].correction), abs=1e-9)
    return team, before, after


def cost_of(objective, team, action):
    outlook = look_ahead(team, DYNAMICS.preview(objective.look_ahead))
    return objective.evaluate(outlook.forecast.at(action)[0], outlook).cost


def test_formations_are_preferences_and_safety_is_required():
    names = {kind.__struct_config__.tag for kind in BUILT_IN if kind.preference}
    assert names == {"spatial_order", "spacing", "clustering", "attraction"}
    assert not Objective.preference


@settings(max_examples=60, deadline=None)
@given(seed=seeds, values=weights, reach=reaches)
def test_preferences_move_an_action_by_reach_at_most(seed, values, reach):
    _, before, after = corrected(weighted(values), seed, reach)
    rounding = 1e-15 * np.abs(before).max()
    assert np.linalg.norm(after - before) <= reach * (1 + 1e-9) + 1e-9 + 4 * rounding


@pytest.mark.parametrize("limit", LIMITS, ids=lambda objective: objective.name)
@settings(max_examples=60, deadline=None)
@given(seed=seeds, values=weights, reach=reaches, place=st.integers(0, len(WISHES)))
def test_a_limit_holds_afterwards_whatever_is_preferred(limit, seed, values, reach, place):
    """One limit and one teammate, for which a Newton step is exact; named in any order."""
    objectives = weighted(values)
    objectives.insert(place, limit)
    team, _, after = corrected(objectives, seed, reach, teammates=1)
    assert cost_of(limit, team, after) <= 1e-12


def test_limits_that_preferences_would_break_are_what_is_tested_above():
    broken = 0
    for seed in range(20):
        team, before, after = corrected(WISHES, seed, reach=5.0, teammates=1)
        broken += any(cost_of(limit, team, after) > 0.0 == cost_of(limit, team, before) for limit in LIMITS)
    assert broken > 3


class Wish(Quadratic, frozen=True, kw_only=True, tag="wish"):
    """Nearest to a goal in the plane of actions."""

    preference: ClassVar[bool] = True


@settings(deadline=None)
@given(
    goal=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    start=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    reach=st.floats(0.0, 4.0),
)
def test_one_preference_goes_to_its_goal_or_as_far_as_it_may(goal, start, reach):
    """In closed form: five half steps leave 1/32 of a way within reach, else the ball's nearest point."""
    team, observation = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0))), np.zeros((1, 1), np.float32)
    flow, wish = gaussian_flow(0.5, np.array([0.3, -0.2]), 5), [Wish(goal=goal)]
    before, after = (
        np.array(
            guided_action(flow, observation, team, make_guide(ObjectiveSet(wish, chosen), UNIT), start).action
        )
        for chosen in (
            GuidanceSettings(mode="hierarchical", scale=0.1),
            GuidanceSettings(scale=0.1, reach=reach),
        )
    )
    way = np.array(goal) - before
    length = min(31 / 32 * np.linalg.norm(way), reach)
    expected = before + length * way / max(np.linalg.norm(way), 1e-12)
    assert after == pytest.approx(expected, abs=1e-9)


def test_several_preferences_settle_on_their_weighted_compromise():
    team, observation = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0))), np.zeros((1, 1), np.float32)
    wishes = [Wish(goal=(1.0, 0.0), weight=1.5), Wish(goal=(0.0, 1.0), weight=0.5)]
    guide = guide_for(wishes, UNIT, scale=1e-3, reach=10.0)
    action = guided_action(gaussian_flow(0.5, np.zeros(2), 5), observation, team, guide).action
    assert action == pytest.approx((0.75, 0.25), abs=1e-6)  # weights sum to 2: half a step is Newton's


class GoEast(Objective, frozen=True, kw_only=True, tag="go_east_please"):
    preference: ClassVar[bool] = True

    def evaluate(self, motion, outlook):
        return Slope(1.0, d_vx=-1e3)


@pytest.mark.parametrize("named_first", ["wish", "limit"])
def test_requirements_have_the_last_word(named_first):
    limit, wish = SpeedLimit(limit_m_s=0.2, buffer_m_s=0.0), GoEast()
    objectives = [wish, limit] if named_first == "wish" else [limit, wish]
    team, _, after = corrected(objectives, 0, reach=100.0)
    preview = DYNAMICS.preview(1)
    velocity = preview.velocity_decay * np.array(team.own.velocity_m_s) + preview.velocity_gain * after
    assert np.linalg.norm(velocity) == pytest.approx(0.2)  # as fast east as it may, no faster
    assert velocity[0] > 0.0


@pytest.mark.parametrize("mode", ["none", "hierarchical", "cone"])
def test_only_mode_terminal_tells_preferences_from_requirements(mode):
    guide = guide_for([*WISHES, *LIMITS], mode=mode)
    assert not guide.corrected
    assert guide.preferences == guide.requirements == ()
    guide = guide_for([*WISHES, *LIMITS])
    assert (guide.preferences, guide.requirements) == ((0, 1, 2), (3, 4))


def test_without_reach_preferences_leave_the_finished_action_alone():
    _, before, after = corrected(WISHES, 3, reach=0.0)
    assert after == pytest.approx(before, abs=0.0)
