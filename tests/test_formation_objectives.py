"""Spatial order and spacing against finite differences, torch autograd and what they promise."""

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.functional import huber_loss

from edge_runtime.dynamics import Dynamics
from edge_runtime.gradient_check import check_gradient
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.objectives import BUILT_IN, Slope, Spacing, SpatialOrder
from edge_runtime.scene import TeamBatch, look_ahead, look_ahead_batch

DYNAMICS = Dynamics(mass_kg=1 / 0.7, drag=0.25, dt_s=0.1)
OBJECTIVES = [
    SpatialOrder(order=(1, 0, 3, 2, 4, 5), gap_m=0.08),
    SpatialOrder(order=(2, 0, 1), gap_m=0.3, pull=20.0, look_ahead=1),
    Spacing(distance_m=0.15),
    Spacing(distance_m=0.5, look_ahead=1),
]


def team_batch(generator, rows=200, robots=5):
    ids = np.stack([generator.permutation(robots) for _ in range(rows)])
    position, velocity, action = generator.uniform(-0.4, 0.4, (3, rows, robots, 2))
    return TeamBatch(
        robot_id=ids[:, 0],
        position_m=position[:, 0],
        velocity_m_s=velocity[:, 0],
        mate_id=ids[:, 1:],
        mate_position_m=position[:, 1:],
        mate_velocity_m_s=velocity[:, 1:],
        mate_action=action[:, 1:],
    )


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


def order_cost(objective, position, team, gain):
    """Every pair (left, right) of the order that the robot is part of, written out."""
    cost = torch.zeros(())
    places = dict(zip(team[0], position, strict=True))
    for k, left in enumerate(objective.order):
        for right in objective.order[k + 1 :]:
            if team[0][0] in (left, right) and {left, right} <= places.keys():
                missing = (places[left][0] + objective.gap_m - places[right][0]).clamp_min(0)
                cost = cost + huber_loss(missing / gain, torch.zeros_like(missing), delta=objective.pull)
    return cost


def spacing_cost(objective, position, _team, gain):
    return 0.5 * (((position[1:] - position[0]).norm(dim=-1).min() - objective.distance_m) / gain) ** 2


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: f"{o.name}-{o.look_ahead}")
def test_slopes_are_those_of_autograd(objective):
    team = team_batch(np.random.default_rng(2))
    outlook = look_ahead_batch(team, DYNAMICS.preview(objective.look_ahead))
    batch = objective.evaluate_batch(outlook.drift_position_m, outlook.drift_velocity_m_s, outlook)
    oracle = order_cost if isinstance(objective, SpatialOrder) else spacing_cost
    for i in range(len(team.robot_id)):
        own = torch.tensor(outlook.drift_position_m[i], requires_grad=True)
        position = [own, *torch.tensor(outlook.mate_position_m[i])]
        ids = [int(team.robot_id[i]), *team.mate_id[i].tolist()]
        if oracle is spacing_cost:
            position = torch.stack(position)
        cost = oracle(objective, position, (ids,), outlook.preview.position_gain)
        slope = torch.autograd.grad(cost, own)[0] if cost.requires_grad else torch.zeros(2)
        assert batch.cost[i] == pytest.approx(cost.item(), rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(batch.d_position[i], slope.numpy(), rtol=1e-9, atol=1e-9)
    assert not batch.d_velocity.any()


@pytest.mark.parametrize(
    ("objective", "neighbour"),
    [(SpatialOrder(order=(0, 1), gap_m=0.1), (1, 0.09, 0.3)), (Spacing(distance_m=0.3), (1, 0.0, 0.1))],
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
    team = TeamBatch(np.array([1, 2]), *np.zeros((2, 2, 2)), np.array([[2], [1]]), *np.zeros((3, 2, 1, 2)))
    outlook = look_ahead_batch(team, DYNAMICS.preview(4))
    batch = objective.evaluate_batch(outlook.drift_position_m, outlook.drift_velocity_m_s, outlook)
    assert batch.d_position[:, 0].tolist() == pytest.approx([first, second])


def test_a_robot_alone_has_no_slope_in_a_batch():
    team = TeamBatch(np.array([0]), *np.zeros((2, 1, 2)), np.zeros((1, 0), int), *np.zeros((3, 1, 0, 2)))
    outlook = look_ahead_batch(team, DYNAMICS.preview(4))
    for objective in OBJECTIVES:
        batch = objective.evaluate_batch(outlook.drift_position_m, outlook.drift_velocity_m_s, outlook)
        assert not any(np.any(part) for part in batch)


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
    ],
)
def test_bad_values_are_refused_in_one_line(wrong, complaint):
    kind = next(c for c in BUILT_IN if c.__struct_config__.tag == wrong["type"])
    with pytest.raises(msgspec.ValidationError, match=complaint) as caught:
        msgspec.convert(wrong, kind)
    assert "\n" not in str(caught.value)
