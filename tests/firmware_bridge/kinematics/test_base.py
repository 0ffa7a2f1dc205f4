import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.errors import BridgeError
from firmware_bridge.kinematics.base import Base, BaseMotion, motion_for, turning, yaw_from_steering

OMNI = Base("omnidirectional")
STRICT = Base("differential")
AHEAD = Base("differential", "lookahead", 0.2, 2.0)
CAR = Base("ackermann", "lookahead", 0.3, 2.0, wheelbase_m=0.5, max_steering_rad=0.6)
component = st.floats(-1, 1)
heading = st.floats(-math.pi, math.pi)


@given(component, component, heading)
def test_omnidirectional_bases_do_what_is_asked(x, y, angle):
    motion = motion_for((x, y), angle, OMNI)
    team = complex(motion.forward_m_s, motion.lateral_m_s) * complex(math.cos(angle), math.sin(angle))
    assert team == pytest.approx(complex(x, y), abs=1e-12)
    assert motion.yaw_rad_s == 0.0


@given(component, component, heading)
def test_the_point_ahead_moves_as_asked_up_to_the_yaw_limit(x, y, angle):
    motion = motion_for((x, y), angle, AHEAD)
    point = complex(motion.forward_m_s, 0.2 * motion.yaw_rad_s) * complex(math.cos(angle), math.sin(angle))
    asked = complex(x, y)
    assert abs(motion.yaw_rad_s) <= 2.0 + 1e-12
    if abs(motion.yaw_rad_s) < 2.0 - 1e-9:
        assert point == pytest.approx(asked, abs=1e-12)
    assert (point * asked.conjugate()).imag == pytest.approx(0.0, abs=1e-12)
    assert abs(point) <= abs(asked) + 1e-12


@pytest.mark.parametrize("base", [STRICT, msgspec.structs.replace(CAR, sideways="refuse")])
def test_sideways_is_refused_where_configured(base):
    assert motion_for((0.5, 0.0), 0.0, base) == BaseMotion(0.5)
    assert motion_for((0.5, 0.0099), 0.0, base) == BaseMotion(0.5)
    with pytest.raises(BridgeError, match="lookahead"):
        motion_for((0.5, -0.011), 0.0, base)


@given(component, component)
def test_cars_stay_within_their_steering(x, y):
    motion = motion_for((x, y), 0.0, CAR)
    assert abs(motion.steering_rad) <= 0.6
    assert motion.yaw_rad_s == pytest.approx(motion.forward_m_s * math.tan(motion.steering_rad) / 0.5)


def test_cars_steer_to_the_asked_curve():
    motion = motion_for((0.5, 0.1), 0.0, CAR)
    assert motion.yaw_rad_s == pytest.approx(0.1 / 0.3)
    assert motion.steering_rad == pytest.approx(math.atan(0.5 * (0.1 / 0.3) / 0.5))


INNER = msgspec.structs.replace(CAR, track_m=0.4)


@given(st.floats(0.01, 1), component)
def test_where_the_inner_wheels_angle_is_told_the_middle_takes_the_curve(x, y):
    """From the geometry: the inner wheel's turning centre lies half a track nearer than the middle's."""
    motion = motion_for((x, y), 0.0, INNER)
    assert yaw_from_steering(motion.forward_m_s, motion.steering_rad, INNER) == pytest.approx(
        motion.yaw_rad_s
    )
    assert abs(motion.steering_rad) <= 0.6
    if abs(motion.steering_rad) > 1e-6:
        radius = 0.5 / math.tan(abs(motion.steering_rad)) + 0.2
        assert abs(motion.yaw_rad_s) == pytest.approx(motion.forward_m_s / radius)


def test_a_curve_about_the_inner_wheel_is_the_sharpest():
    sharp = msgspec.structs.replace(INNER, max_yaw_rad_s=math.inf, lookahead_m=0.01)
    assert motion_for((0.1, 0.1), 0.0, sharp).steering_rad == 0.6
    assert motion_for((-0.1, 0.1), 0.0, sharp).steering_rad == -0.6


def test_standing_cars_only_turn_their_wheels():
    assert motion_for((0.0, 0.1), 0.0, CAR) == BaseMotion(0.0, 0.0, 0.0, 0.6)
    assert motion_for((0.0, -0.1), 0.0, CAR) == BaseMotion(0.0, 0.0, 0.0, -0.6)
    assert motion_for((0.0, 0.0), 0.0, CAR) == BaseMotion()
    assert yaw_from_steering(0.0, 0.6, CAR) == 0.0


@given(component, st.floats(-2, 2), heading)
def test_bases_turn_as_a_policy_asks_within_their_limit(speed, turn, angle):
    """The velocity points where the robot will look by then, here 0.05 s ahead."""
    ahead = angle + 0.05 * turn
    velocity = speed * math.cos(ahead), speed * math.sin(ahead)
    rolling = motion_for(velocity, angle, turning(AHEAD), turn)
    assert (rolling.forward_m_s, rolling.lateral_m_s) == (pytest.approx(speed, abs=1e-12), 0.0)
    assert rolling.yaw_rad_s == turn
    assert turning(AHEAD).reference_m == 0.0
    slipping = motion_for(velocity, angle, OMNI, turn)
    assert math.hypot(slipping.forward_m_s, slipping.lateral_m_s) == pytest.approx(abs(speed))
    assert slipping.yaw_rad_s == turn
    fast = motion_for(velocity, angle, turning(AHEAD), 4.0)
    assert (fast.forward_m_s, fast.yaw_rad_s) == (pytest.approx(speed / 2.0), 2.0)


def test_cars_turn_by_steering():
    motion = motion_for((0.5, 0.0), 0.0, turning(CAR), 0.25)
    assert (motion.forward_m_s, motion.yaw_rad_s) == pytest.approx((0.5, 0.25))
    assert motion.steering_rad == pytest.approx(math.atan(0.5 * 0.5))


def test_slowing_down_keeps_the_curve():
    assert BaseMotion(1.0, 2.0, 3.0, 0.4).scaled(0.5) == BaseMotion(0.5, 1.0, 1.5, 0.4)


def test_the_reference_point():
    assert (OMNI.reference_m, STRICT.reference_m, AHEAD.reference_m) == (0.0, 0.0, 0.2)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"kind": "differential", "sideways": "lookahead"}, "lookahead_m"),
        ({"kind": "ackermann", "wheelbase_m": 1.0}, "max_steering_rad"),
        ({"kind": "omnidirectional", "max_yaw_rad_s": 0.0}, "max_yaw_rad_s"),
        ({"kind": "omnidirectional", "track_m": -0.1}, "track_m"),
        ({"kind": "hover"}, "kind"),
    ],
)
def test_wrong_bases_are_refused(values, key):
    with pytest.raises(msgspec.ValidationError, match=key):
        msgspec.convert(values, Base)
