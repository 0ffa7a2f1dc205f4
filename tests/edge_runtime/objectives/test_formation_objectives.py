"""Spatial order, passing and spacing against finite differences, torch autograd and what they promise."""

import math
from itertools import combinations, pairwise

import msgspec
import numpy as np
import pytest
import torch
from guidance_cases import random_team
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.functional import huber_loss

from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.outlook import PredictedMotion, look_ahead
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import BUILT_IN, Passing, Slope, Spacing, SpatialOrder
from edge_runtime.objectives.gradient_check import check_gradient

DYNAMICS = PointForce(mass_kg=1 / 0.7, drag=0.25, dt_s=0.1)
OBJECTIVES = [
    SpatialOrder(order=(1, 0, 3, 2, 4, 5), gap_m=0.08),
    SpatialOrder(order=(2, 0, 1), gap_m=0.3, pull=20.0, look_ahead=1),
    Spacing(distance_m=0.15),
    Spacing(distance_m=0.5, look_ahead=1),
    Passing(order=(1, 0, 3, 2, 4, 5), reach_m=1.0, clearance_m=0.3),
    Passing(order=(2, 0, 1), reach_m=0.6, margin_m=0.1, clearance_m=0.4, pull=0.5, look_ahead=1),
]


def view(own, *others):
    """What robot ``own`` = (id, x, y) knows of the ``others``, all at rest."""
    states = [RobotState(robot, 0.0, (x, y), (0.0, 0.0)) for robot, x, y in (own, *others)]
    return TeamState(states[0], tuple(Teammate(state) for state in states[1:]))


def slope_at(objective, own, *others):
    outlook = look_ahead(view(own, *others), DYNAMICS.preview(objective.look_ahead))
    return objective.evaluate(outlook.drift, outlook)


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: f"{o.name}-{o.look_ahead}")
@pytest.mark.parametrize("teammates", [1, 5])
def test_gradients(objective, teammates):
    assert check_gradient(objective, DYNAMICS, teammates=teammates).active > 50


def pull_of(missing, objective, gain):
    cure = missing.clamp_min(0) / gain
    return huber_loss(cure, torch.zeros_like(cure), delta=objective.pull)


def pairs_of(objective, ids):
    """Every pair (left, right) of the order that the first robot is part of, written out."""
    for k, left in enumerate(objective.order):
        for right in objective.order[k + 1 :]:
            if ids[0] in (left, right) and {left, right} <= set(ids):
                yield left, right


def order_cost(objective, position, ids, gain, _drift):
    cost, place = torch.zeros(()), dict(zip(ids, position, strict=True))
    for left, right in pairs_of(objective, ids):
        cost = cost + pull_of(place[left][0] + objective.gap_m - place[right][0], objective, gain)
    return cost


def passing_cost(objective, position, ids, gain, drift):
    """The right one of every pair that is about to pass goes below the left one."""
    cost, place = torch.zeros(()), dict(zip(ids, position, strict=True))
    where = dict(zip(ids, [drift, *position[1:]], strict=True))
    for left, right in pairs_of(objective, ids):
        near = (where[left] - where[right]).norm() < objective.reach_m
        if right == ids[0] and near and where[right][0] < where[left][0] + objective.margin_m:
            cost = cost + pull_of(place[right][1] + objective.clearance_m - place[left][1], objective, gain)
    return cost


def spacing_cost(objective, position, _ids, gain, _drift):
    distance = (torch.stack(position[1:]) - position[0]).norm(dim=-1).min()
    return 0.5 * ((distance - objective.distance_m) / gain) ** 2


ORACLES = {SpatialOrder: order_cost, Passing: passing_cost, Spacing: spacing_cost}


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: f"{o.name}-{o.look_ahead}")
def test_slopes_are_those_of_autograd(objective):
    draw, active = np.random.default_rng(2), 0
    for _ in range(200):
        outlook = look_ahead(
            random_team(draw, 4, draw.permutation(5).tolist()), DYNAMICS.preview(objective.look_ahead)
        )
        x, y, vx, vy = outlook.drift[:4]
        moved = np.array([x, y]) + draw.uniform(-0.1, 0.1, 2)
        slope = objective.evaluate(PredictedMotion(*moved.tolist(), vx, vy), outlook)
        own, drift = torch.tensor(moved, requires_grad=True), torch.tensor([x, y], dtype=torch.float64)
        mates = [torch.tensor([mate.x, mate.y], dtype=torch.float64) for mate in outlook.neighbours]
        ids = [outlook.robot_id, *(mate.robot_id for mate in outlook.neighbours)]
        gain = outlook.preview.position_gain
        cost = ORACLES[type(objective)](objective, [own, *mates], ids, gain, drift)
        expected = torch.autograd.grad(cost, own)[0] if cost.requires_grad else torch.zeros(2)
        assert slope.cost == pytest.approx(cost.item(), rel=1e-9, abs=1e-12)
        np.testing.assert_allclose((slope.d_x, slope.d_y), expected.numpy(), rtol=1e-9, atol=1e-9)
        assert (slope.d_vx, slope.d_vy) == (0.0, 0.0)
        active += slope.cost > 0.0
    assert active > 20


@pytest.mark.parametrize(
    ("objective", "neighbour"),
    [
        (SpatialOrder(order=(0, 1), gap_m=0.1), (1, 0.09, 0.3)),
        (Spacing(distance_m=0.3), (1, 0.0, 0.1)),
        (Passing(order=(1, 0)), (1, 0.01, 0.01)),
    ],
)
def test_cost_is_half_the_squared_action_that_cures(objective, neighbour):
    preview = DYNAMICS.preview(objective.look_ahead)
    outlook = look_ahead(view((0, 0.0, 0.0), neighbour), preview)
    slope = objective.evaluate(outlook.drift, outlook)
    downhill = -np.array(slope[1:3]) / np.hypot(*slope[1:3])
    x, y = preview.position_gain * math.sqrt(2 * slope.cost) * downhill
    cured = objective.evaluate(outlook.drift._replace(x=x, y=y), outlook)
    assert cured.cost == pytest.approx(0, abs=1e-12)


@settings(deadline=None)
@given(
    x=st.lists(st.floats(-1, 1), min_size=5, max_size=5),
    y=st.lists(st.floats(-1, 1), min_size=5, max_size=5),
    order=st.permutations(range(5)),
)
def test_only_the_order_with_its_gaps_costs_nothing(x, y, order):
    objective = SpatialOrder(order=tuple(order), gap_m=0.08)
    robots = [(i, x[i], y[i]) for i in range(5)]
    slopes = [slope_at(objective, own, *robots[:i], *robots[i + 1 :]) for i, own in enumerate(robots)]
    kept = all(x[right] - x[left] >= 0.08 for left, right in pairwise(order))
    assert kept == (sum(slope.cost for slope in slopes) == 0)
    assert sum(slope.d_x for slope in slopes) == pytest.approx(0, abs=1e-6)
    assert not any(slope.d_y for slope in slopes)


@settings(max_examples=20, deadline=None)
@given(order=st.permutations(range(5)))
def test_descent_reaches_every_order_from_any_other(order):
    objective, x, step = SpatialOrder(order=tuple(order), gap_m=0.08), 0.19 * np.arange(5), 2e-4
    for _ in range(600):
        robots = [(i, x[i], 0.0) for i in range(5)]
        x = x - step * np.array(
            [slope_at(objective, own, *robots[:i], *robots[i + 1 :]).d_x for i, own in enumerate(robots)]
        )
    assert np.argsort(x).tolist() == list(order)


def test_no_neighbour_pulls_harder_than_it_may():
    objective = SpatialOrder(order=(0, 1, 2), gap_m=0.08, pull=0.3)
    gain = DYNAMICS.preview(objective.look_ahead).position_gain
    one, two = (1, -0.5, 0.0), (2, -2.0, 0.0)
    assert gain * slope_at(objective, (0, 0.0, 0.0), one).d_x == pytest.approx(0.3)
    assert gain * slope_at(objective, (0, 0.0, 0.0), one, two).d_x == pytest.approx(0.6)


def test_a_lost_neighbour_leaves_the_others_to_keep_the_order():
    objective = SpatialOrder(order=(1, 0, 3, 2, 4), gap_m=0.08)
    assert slope_at(objective, (0, 0.5, 0.0), (2, 0.1, 0.0)).d_x > 0
    assert slope_at(objective, (0, 0.5, 0.0)) == Slope(0.0)


def test_robots_that_the_order_does_not_name_are_free():
    objective = SpatialOrder(order=(0, 1), gap_m=0.1)
    assert slope_at(objective, (7, 0.5, 0.0), (0, 0.6, 0.0)) == Slope(0.0)
    assert slope_at(objective, (0, 0.5, 0.0), (7, 0.1, 0.0)) == Slope(0.0)
    assert slope_at(objective, (0, 0.5, 0.0), (7, 0.4, 0.0), (1, 0.45, 0.0)).d_x > 0


@settings(deadline=None)
@given(
    x=st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=2),
    y=st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=2),
    order=st.permutations(range(2)),
)
def test_of_two_robots_that_pass_only_the_later_one_gives_way(x, y, order):
    objective = Passing(order=tuple(order))
    first, later = ((i, x[i], y[i]) for i in order)
    gives = slope_at(objective, later, first)
    about_to_pass = later[1] < first[1] and math.dist(first[1:], later[1:]) < objective.reach_m
    in_the_way = later[2] + objective.clearance_m > first[2]
    assert slope_at(objective, first, later) == Slope(0.0)
    assert (gives.cost > 0.0) == (about_to_pass and in_the_way)
    assert gives.d_y >= 0.0 == gives.d_x


@settings(deadline=None)
@given(y=st.lists(st.floats(-0.03, 0.03), min_size=5, max_size=5), order=st.permutations(range(5)))
def test_of_each_pair_in_the_wrong_order_exactly_one_gives_way(y, order):
    objective, robots = Passing(order=tuple(order)), [(i, 0.01 * i, y[i]) for i in range(5)]
    for west, east in combinations(robots, 2):
        wrong = order.index(west[0]) > order.index(east[0])
        costs = slope_at(objective, west, east).cost, slope_at(objective, east, west).cost
        assert [cost > 0.0 for cost in costs] == [wrong, False]


def test_no_neighbour_makes_a_robot_give_way_harder_than_it_may():
    objective = Passing(order=(1, 2, 0), pull=0.3)
    gain = DYNAMICS.preview(objective.look_ahead).position_gain
    one, two = (1, 0.01, 0.05), (2, 0.02, 0.03)
    assert gain * slope_at(objective, (0, 0.0, 0.0), one).d_y == pytest.approx(0.3)
    assert gain * slope_at(objective, (0, 0.0, 0.0), one, two).d_y == pytest.approx(0.6)


def test_passing_leaves_robots_alone_that_its_order_does_not_name():
    objective = Passing(order=(0, 1))
    assert slope_at(objective, (7, 0.0, 0.0), (0, 0.01, 0.0)) == Slope(0.0)
    assert slope_at(objective, (1, 0.0, 0.0), (7, 0.01, 0.0)) == Slope(0.0)
    assert slope_at(objective, (1, 0.0, 0.0)) == Slope(0.0)


def test_spacing_heeds_only_the_closest_neighbour():
    objective = Spacing(distance_m=0.15)
    near, far = (1, 0.1, 0.0), (2, -0.12, 0.0)
    assert slope_at(objective, (0, 0.0, 0.0), near, far) == slope_at(objective, (0, 0.0, 0.0), near)
    assert (
        slope_at(objective, (0, 0.0, 0.0), near).d_x
        > 0
        > slope_at(objective, (0, 0.0, 0.0), (1, 0.3, 0.0)).d_x
    )
    assert slope_at(objective, (0, 0.0, 0.0)) == Slope(0.0)


def test_coincident_robots_are_driven_apart_by_their_order():
    objective = Spacing(distance_m=0.15)
    first, second = (slope_at(objective, (a, 0.0, 0.0), (b, 0.0, 0.0)).d_x for a, b in ((1, 2), (2, 1)))
    assert first == -second > 0


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"type": "spatial_order", "order": [0], "gap_m": 0.1}, "order"),
        ({"type": "spatial_order", "order": [0, 1, 0], "gap_m": 0.1}, "each once"),
        ({"type": "spatial_order", "order": [0, "1"], "gap_m": 0.1}, "order"),
        ({"type": "spatial_order", "order": [0, 1], "gap_m": -0.1}, "gap_m"),
        ({"type": "spatial_order", "order": [0, 1], "gap_m": math.inf}, "finite"),
        ({"type": "spatial_order", "order": [0, 1], "gap_m": 0.1, "pull": 0.0}, "pull"),
        ({"type": "spatial_order", "order": [0, 1]}, "gap_m"),
        ({"type": "spacing", "distance_m": 0.0}, "positive"),
        ({"type": "spacing", "distance_m": math.nan}, "finite"),
        ({"type": "spacing", "distance_m": 0.1, "gap_m": 0.1}, "gap_m"),
        ({"type": "passing"}, "order"),
        ({"type": "passing", "order": [0]}, "at least two"),
        ({"type": "passing", "order": [0, 1, 0]}, "each once"),
        ({"type": "passing", "order": [0, 1], "reach_m": 0.0}, "`reach_m` must be positive, got 0"),
        ({"type": "passing", "order": [0, 1], "clearance_m": -0.1}, "`clearance_m` must be positive"),
        ({"type": "passing", "order": [0, 1], "pull": 0.0}, "`pull` must be positive"),
        ({"type": "passing", "order": [0, 1], "margin_m": -0.1}, "`margin_m` must not be negative"),
        ({"type": "passing", "order": [0, 1], "margin_m": math.inf}, "finite"),
        ({"type": "passing", "order": [0, 1], "reach_m": 1e9}, "reach_m"),
        ({"type": "passing", "order": [0, 1], "look_ahead": 0}, "look_ahead"),
        ({"type": "passing", "order": [0, 1], "gap_m": 0.1}, "gap_m"),
    ],
)
def test_bad_values_are_refused_in_one_line(wrong, complaint):
    kind = next(c for c in BUILT_IN if c.__struct_config__.tag == wrong["type"])
    with pytest.raises(msgspec.ValidationError, match=complaint) as caught:
        msgspec.convert(wrong, kind)
    assert "\n" not in str(caught.value)
