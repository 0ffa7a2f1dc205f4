"""Every objective passes the one gradient checker; wrong ones do not."""

import math

import msgspec
import numpy as np
import pytest

from edge_runtime.errors import GradientError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import (
    BUILT_IN,
    Attraction,
    Objective,
    ObstacleMargin,
    SafetyMargin,
    Slope,
    SpeedLimit,
    TrackedMargin,
)
from edge_runtime.objectives.gradient_check import check_gradient

OBJECTIVES = [
    SpeedLimit(limit_m_s=0.3),
    SafetyMargin(distance_m=0.25),
    SafetyMargin(distance_m=0.6, look_ahead=8),
    ObstacleMargin(distance_m=0.3),
    TrackedMargin(object="person", distance_m=0.3),
    Attraction(object="person", pull=2.0),
]


class StayNorth(Objective, frozen=True, kw_only=True, tag="stay_north"):
    """A user's objective."""

    line_m: float

    def evaluate(self, motion, outlook):
        depth = max(0.0, self.line_m - motion.y) / outlook.preview.position_gain
        return Slope(0.5 * depth * depth, d_y=-depth / outlook.preview.position_gain)


class WrongSign(StayNorth, frozen=True, kw_only=True, tag="wrong_sign"):
    def evaluate(self, motion, outlook):
        cost, *_, d_y, _, _ = super().evaluate(motion, outlook)
        return Slope(cost, d_y=-d_y)


@pytest.mark.parametrize("objective", [*OBJECTIVES, StayNorth(line_m=0.1)], ids=lambda o: o.name)
@pytest.mark.parametrize("teammates", [1, 5])
def test_gradients(objective, teammates):
    assert check_gradient(objective, teammates=teammates).active > 50


@pytest.mark.parametrize(
    ("objective", "complaint"),
    [
        (WrongSign(line_m=0.1), "d cost / d y is stated as"),
        (StayNorth(line_m=-50.0), "never active"),
    ],
)
def test_the_checker_finds_mistakes(objective, complaint):
    with pytest.raises(GradientError, match=complaint):
        check_gradient(objective)


def test_speed_cost_is_the_action_that_cures_it():
    dynamics = PointForce(mass_kg=2.0, drag=0.1, dt_s=0.05)
    state = RobotState(0, 0.0, (0.0, 0.0), (1.0, 0.0))
    outlook = look_ahead(TeamState(state), dynamics.preview(1))
    slope = SpeedLimit(limit_m_s=0.5, buffer_m_s=0.0).evaluate(outlook.drift, outlook)
    cure = math.sqrt(2 * slope.cost)
    preview = dynamics.preview(1)
    assert preview.velocity_decay * 1.0 - preview.velocity_gain * cure == pytest.approx(0.5)


def test_coincident_robots_are_driven_apart_by_their_order():
    def slope(own, other):
        mate = Teammate(RobotState(other, 0.0, (0.0, 0.0), (0.0, 0.0)))
        team = TeamState(RobotState(own, 0.0, (0.0, 0.0), (0.0, 0.0)), (mate,))
        outlook = look_ahead(team, PointForce(mass_kg=1.0, drag=0.0, dt_s=0.1).preview(1))
        return SafetyMargin(distance_m=0.2, look_ahead=1).evaluate(outlook.drift, outlook)

    assert slope(1, 2).d_x == -slope(2, 1).d_x != 0.0


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"type": "speed_limit", "limit_m_s": math.inf}, "finite"),
        ({"type": "speed_limit", "limit_m_s": 0.3, "weight": math.nan}, "finite"),
        ({"type": "speed_limit", "limit_m_s": 0.3, "weight": -1.0}, "negative"),
        ({"type": "speed_limit", "limit_m_s": 0.3, "buffer_m_s": 0.3}, "buffer_m_s"),
        ({"type": "safety_margin", "distance_m": 0.0}, "positive"),
        ({"type": "safety_margin", "distance_m": 0.2, "look_ahead": 0}, "look_ahead"),
        ({"type": "safety_margin", "distance_m": 0.2, "look_ahead": 10**9}, "look_ahead"),
        ({"type": "safety_margin", "distance": 0.2}, "distance"),
    ],
)
def test_bad_values_are_refused(wrong, complaint):
    kind = next(c for c in BUILT_IN if c.__struct_config__.tag == wrong["type"])
    with pytest.raises(msgspec.ValidationError, match=complaint):
        msgspec.convert(wrong, kind)


def test_inactive_objectives_have_no_slope():
    margin = SafetyMargin(distance_m=0.2)
    alone = look_ahead(
        TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0))), PointForce(1.0, 0.0, 0.1).preview(3)
    )
    assert margin.evaluate(alone.drift, alone) == Slope(0.0)
    assert not np.any(SpeedLimit(limit_m_s=1.0).evaluate(alone.drift, alone))


@pytest.mark.parametrize(("objective", "numbers", "blamed"), [
    (SpeedLimit, {"limit_m_s": -0.2}, "`limit_m_s` must be positive, got -0.2"),
    (SpeedLimit, {"limit_m_s": 1.0, "buffer_m_s": 2.0}, "`buffer_m_s` must be below `limit_m_s`"),
    (SpeedLimit, {"limit_m_s": 0.2, "buffer_m_s": -1.0}, "`buffer_m_s` must not be negative, got -1.0"),
    (SafetyMargin, {"distance_m": 0.0}, "`distance_m` must be positive, got 0.0"),
    (ObstacleMargin, {"distance_m": 1.0, "buffer_m": -0.5}, "`buffer_m` must not be negative, got -0.5"),
])  # fmt: skip
def test_the_number_that_is_wrong_is_blamed(objective, numbers, blamed):
    with pytest.raises(ValueError) as caught:
        objective(**numbers)
    assert str(caught.value).startswith(blamed)
