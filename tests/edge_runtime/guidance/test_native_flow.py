"""The guided flow in the compiled kernel is the one in Python: every objective, motion model and mode."""

import math
from typing import get_args

import numpy as np
import pytest
from bundles import MANIFEST
from guidance_cases import DYNAMICS, Stepwise, guide_for, random_team
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_models import EXAMPLES
from msgspec.structs import replace
from networks import needs_kernel, random_weights

from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, Mode, ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState, TrackedObject
from edge_runtime.motion.unicycle import Unicycle
from edge_runtime.objectives import (
    BUILT_IN,
    Attraction,
    Clustering,
    Geofence,
    Objective,
    ObstacleMargin,
    Passing,
    SafetyMargin,
    Slope,
    Spacing,
    SpatialOrder,
    SpeedLimit,
    TrackedMargin,
)
from edge_runtime.policy.compiled_policy import CompiledPolicy
from edge_runtime.policy.velocity_field import PYTHON

pytestmark = needs_kernel
STEPS = 4
SENSOR = MANIFEST.body.sensor()
number, ahead = st.floats(0.05, 2.0), st.integers(1, 6)
share = {"weight": number, "look_ahead": ahead}
order = st.permutations(range(5)).flatmap(lambda ids: st.integers(2, 5).map(lambda n: tuple(ids[:n])))
centre = st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=3).map(tuple)
BUILDERS = {
    SpeedLimit: st.builds(SpeedLimit, limit_m_s=number, **share),
    SafetyMargin: st.builds(SafetyMargin, distance_m=number, **share),
    ObstacleMargin: st.builds(ObstacleMargin, distance_m=number, **share),
    TrackedMargin: st.builds(
        TrackedMargin, object=st.sampled_from(["door", "person", "ghost"]), distance_m=number, **share
    ),
    Attraction: st.builds(
        Attraction, object=st.sampled_from(["door", "person", "ghost"]), pull=number, **share
    ),
    Geofence: st.builds(Geofence, centre_m=centre, radius_m=number, **share),
    Spacing: st.builds(Spacing, distance_m=number, **share),
    Clustering: st.builds(Clustering, radius_m=number, **share),
    SpatialOrder: st.builds(SpatialOrder, order=order, gap_m=number, pull=number, **share),
    Passing: st.builds(
        Passing, order=order, reach_m=number, margin_m=number, clearance_m=number, pull=number, **share
    ),
}
objectives = st.lists(st.one_of(*BUILDERS.values()), max_size=6)
guidance = st.builds(
    GuidanceSettings,
    mode=st.sampled_from(get_args(Mode)),
    scale=st.floats(0.01, 1.0),
    reach=number,
    goal_reach=st.none() | number,
    goal_within_m=number,
    requirement_steps=st.integers(1, 6),
)
POLICIES = {
    d: CompiledPolicy(random_weights(seed=d, action_dim=d), STEPS)
    for d in range(1, 5)
    if not needs_kernel.args[0]
}


def scene(draw, model, mates, ids=None):
    """A team among obstacles and tracked objects."""
    team = random_team(draw, mates, ids, model)
    places, velocities = draw.uniform(-0.5, 0.5, (2, 2, model.dims)).tolist()
    tracked = [
        TrackedObject(name, 0.0, tuple(place), tuple(velocity), goal_m=goal)
        for name, place, velocity, goal in zip(
            ("door", "person"), places, velocities, (None, (0.0,) * model.dims), strict=True
        )
    ]
    ranges = tuple(draw.uniform(0.0, 0.5, len(SENSOR.rays)).tolist()) if model.dims == 2 else None
    return replace(team, tracked=tuple(tracked), ranges_m=ranges, silent=team.teammates[:1])


def both(guide, model, team, seed=0):
    """What the kernel and Python make of one tick."""
    draw, policy = np.random.default_rng(seed), POLICIES[model.action_dim]
    observation = draw.standard_normal((1, 18)).astype(np.float32)
    start = tuple(draw.standard_normal(model.action_dim).tolist())
    with np.errstate(over="ignore"):  # of hostile numbers
        return [guided_action(each, observation, team, guide, start) for each in (policy, Stepwise(policy))]


def agree(found, expected, tolerance=1e-6, *, counts=True):
    """Counts may differ where directions are orthogonal: rounding decides which of them oppose each other."""
    size = max(1.0, np.abs(expected.action).max())
    np.testing.assert_allclose(found.action, expected.action, rtol=0, atol=tolerance * size)
    np.testing.assert_allclose(found.correction, expected.correction, rtol=0, atol=tolerance * size)
    np.testing.assert_allclose(found.costs, expected.costs, rtol=10 * tolerance, atol=tolerance)
    assert (found.steps, found.cut, found.fault) == (expected.steps, expected.cut, expected.fault)
    if counts:
        assert (found.conflicts, found.opposed) == (expected.conflicts, expected.opposed)


@settings(max_examples=150, derandomize=True, deadline=None)
@given(
    model=st.sampled_from([model for model in EXAMPLES.values() if model.action_dim <= 4]),
    asked=objectives,
    guidance=guidance,
    mates=st.integers(0, 6),
    seed=st.integers(0, 999),
)
def test_the_flow_in_the_kernel_is_the_flow_in_python(model, asked, guidance, mates, seed):
    asked = [objective for objective in asked if not objective.refuses(model)]
    guide = replace(make_guide(ObjectiveSet(tuple(asked), guidance), model), sensor=None)
    if model.dims == 2:
        guide = replace(guide, sensor=SENSOR)
    agree(*both(guide, model, scene(np.random.default_rng(seed), model, mates), seed), counts=False)


EACH = [
    SpeedLimit(limit_m_s=0.1),
    SafetyMargin(distance_m=0.6),
    ObstacleMargin(distance_m=0.4),
    TrackedMargin(object="person", distance_m=0.6),
    Geofence(centre_m=(0.1, 0.2), radius_m=0.5),
    Spacing(distance_m=0.3),
    Clustering(radius_m=0.2),
    SpatialOrder(order=(2, 0, 3, 1), gap_m=0.2),
    Passing(order=(2, 3, 1, 0), reach_m=2.0, margin_m=1.0, clearance_m=0.5),
    Attraction(object="person"),
]


@pytest.mark.parametrize("name", [name for name, model in EXAMPLES.items() if model.action_dim <= 4])
def test_every_objective_of_every_model_and_mode_steers_in_the_kernel(name):
    assert {type(objective) for objective in EACH} == {*BUILT_IN} == {*BUILDERS}
    model, steered = EXAMPLES[name], set()
    for objective in EACH:
        if objective.refuses(model):
            continue
        for mode in get_args(Mode):
            guide = replace(guide_for([objective], model, mode=mode, scale=0.5), sensor=None)
            guide = replace(guide, sensor=SENSOR) if model.dims == 2 else guide
            assert (guide.steering.terms[0].kind == PYTHON) == isinstance(model, Unicycle)
            for seed in range(4):
                found, expected = both(guide, model, scene(np.random.default_rng(seed), model, 3), seed)
                agree(found, expected)
                steered |= {objective.name} if found.costs[0] > 0.0 else set()
    assert steered == {objective.name for objective in EACH if not objective.refuses(model)}


@pytest.mark.parametrize("dims", [2, 3])
def test_robots_at_one_place_part_alike(dims):
    """Exactly there in one step from rest, where no direction leads apart."""
    model = EXAMPLES["drone" if dims == 3 else "force"]
    here = RobotState(1, 0.0, (0.1,) * dims, (0.0,) * dims)
    rest = (0.0,) * model.action_dim
    for ids in ((0, 2, 3), (2, 0, 1), (1, 0, 2)):
        own, *others = (replace(here, robot_id=robot) for robot in ids)
        door = TrackedObject("door", 0.0, here.position_m, here.velocity_m_s)
        team = TeamState(own, tuple(Teammate(mate, rest) for mate in others), tracked=(door,))
        for objective in (
            EACH[1],
            Spacing(distance_m=0.1),
            EACH[6],
            TrackedMargin(object="door", distance_m=1.0),
            Attraction(object="door"),
        ):
            guide = guide_for([objective], model, mode="terminal", scale=1e-12)
            agree(*both(guide, model, team))


HOSTILE = [math.nan, math.inf, -math.inf, 1e300, -1e300, 1e100, 1e12, 5e-324, -0.0, 0.0, 0.1]


@settings(max_examples=300, derandomize=True, deadline=None)
@given(
    asked=objectives,
    guidance=guidance,
    numbers=st.lists(st.sampled_from(HOSTILE), min_size=22, max_size=22),
    mates=st.integers(0, 3),
)
def test_hostile_numbers_stop_the_robot_alike(asked, guidance, numbers, mates):
    """What neither can compute is a fault; what both can, is the same. No action is ever not finite.

    States that are not finite never come here: how far they spread before an objective sees them may differ.
    """
    asked = tuple(objective for objective in asked if not objective.refuses(DYNAMICS))
    guide = make_guide(ObjectiveSet(asked, guidance), DYNAMICS)
    pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
    mate = [
        Teammate(RobotState(1 + n, 0.0, *pairs[2 + 3 * n : 4 + 3 * n]), pairs[4 + 3 * n])
        for n in range(mates)
    ]
    team = TeamState(RobotState(0, 0.0, *pairs[:2]), tuple(mate))
    found, expected = both(guide, DYNAMICS, team)
    assert all(map(math.isfinite, (*found.action, *found.correction)))
    if not all(map(math.isfinite, numbers)):
        return
    assert bool(found.fault) == bool(expected.fault)
    if not found.fault and max(map(abs, numbers)) < 1e50:
        agree(found, expected, 1e-4, counts=False)


class StayNorth(Objective, frozen=True, kw_only=True, tag="stay_north"):
    line_m: float

    def evaluate(self, motion, outlook):
        cure = max(0.0, self.line_m - motion.y) / outlook.preview.position_gain
        return Slope(cost=0.5 * cure * cure, d_y=-cure / outlook.preview.position_gain)


@pytest.mark.parametrize("mode", get_args(Mode))
def test_an_own_objective_steers_beside_those_of_the_kernel(mode):
    guide = guide_for([EACH[0], StayNorth(line_m=0.3), EACH[6], EACH[1]], mode=mode, scale=1.0)
    assert [term.kind for term in guide.steering.terms].count(PYTHON) == 1
    for seed in range(10):
        agree(*both(guide, DYNAMICS, scene(np.random.default_rng(seed), DYNAMICS, 3), seed))


def test_a_subclass_of_a_built_in_objective_runs_in_python():
    class Slower(SpeedLimit, frozen=True, kw_only=True, tag="slower"):
        def evaluate(self, motion, outlook):
            return super().evaluate(motion, outlook)

    own, built_in = (guide_for([kind(limit_m_s=0.2)]) for kind in (Slower, SpeedLimit))
    assert own.steering.terms[0].kind == PYTHON
    team = scene(np.random.default_rng(0), DYNAMICS, 3)
    agree(both(own, DYNAMICS, team)[0], both(built_in, DYNAMICS, team)[0])


def failing(slope, after=0):
    """An own objective that goes wrong after so many calls."""
    calls = []

    class Fails(Objective, frozen=True, kw_only=True, tag="fails"):
        def evaluate(self, motion, outlook):
            calls.append(motion)
            return slope() if len(calls) > after else Slope(1.0, 1.0)

    return Fails()


def _raise(error):
    raise error


@pytest.mark.parametrize("mode", ["none", "terminal"])
@pytest.mark.parametrize("after", [0, 2, STEPS])
@pytest.mark.parametrize(
    "slope",
    [
        lambda: Slope(math.nan),
        lambda: Slope(1.0, math.inf),
        lambda: _raise(ZeroDivisionError("no")),
        lambda: None,
    ],
)
def test_an_own_objective_that_fails_is_named_alike(slope, after, mode):
    team, observation = scene(np.random.default_rng(0), DYNAMICS, 3), np.zeros((1, 18), np.float32)
    found, expected = (
        guided_action(policy, observation, team, guide_for([EACH[0], failing(slope, after)], mode=mode))
        for policy in (POLICIES[2], Stepwise(POLICIES[2]))
    )
    assert bool(found.fault) == (after < STEPS + (mode == "terminal"))
    if found.fault:
        assert found == expected
    else:
        agree(found, expected)


def test_ctrl_c_in_an_own_objective_ends_the_run():
    guide, team = (
        guide_for([failing(lambda: _raise(KeyboardInterrupt))]),
        random_team(np.random.default_rng(0)),
    )
    with pytest.raises(KeyboardInterrupt):
        guided_action(POLICIES[2], np.zeros((1, 18), np.float32), team, guide)


def test_an_objective_cannot_sample_the_policy_that_it_guides():
    observation, team = np.zeros((1, 18), np.float32), random_team(np.random.default_rng(0))
    plain = guide_for([EACH[0]])
    guide = guide_for([failing(lambda: guided_action(POLICIES[2], observation, team, plain))])
    assert "samples the policy" in guided_action(POLICIES[2], observation, team, guide).fault
    assert not guided_action(POLICIES[2], observation, team, plain).fault
