import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from firmware_bridge.kinematics.frames import (
    rotate,
    swap_enu_ned,
    swap_flu_frd,
    swap_heading_yaw,
    wrap,
    yaw_of,
)

numbers = st.floats(-1e3, 1e3)
vectors = st.tuples(numbers, numbers)
angles = st.floats(-math.pi, math.pi)


def test_north_is_y_inside_and_x_on_the_wire():
    assert swap_enu_ned((0.0, 1.0)) == (1.0, 0.0)


def test_left_is_y_inside_and_minus_y_on_the_wire():
    assert swap_flu_frd((1.0, 2.0)) == (1.0, -2.0)


@pytest.mark.parametrize(
    ("heading", "yaw"),
    [(0.0, math.pi / 2), (math.pi / 2, 0.0), (math.pi, -math.pi / 2), (-math.pi / 2, math.pi)],
)
def test_heading_counts_from_east_and_yaw_from_north(heading, yaw):
    assert swap_heading_yaw(heading) == pytest.approx(yaw)
    assert swap_heading_yaw(yaw) == pytest.approx(heading)


@given(angles)
def test_heading_and_yaw_point_the_same_way(heading):
    yaw = swap_heading_yaw(heading)
    north_east = (math.cos(yaw), math.sin(yaw))
    assert swap_enu_ned(north_east) == pytest.approx((math.cos(heading), math.sin(heading)), abs=1e-9)


@given(vectors, angles)
def test_body_vectors_reach_the_same_place_through_either_frames(body, heading):
    """FLU -> ENU -> NED equals FLU -> FRD -> NED, with SciPy's rotations as oracle."""
    through_enu = swap_enu_ned(rotate(body, heading))
    yaw = Rotation.from_euler("ZYX", [swap_heading_yaw(heading), 0.0, 0.0])
    through_frd = yaw.apply([*swap_flu_frd(body), 0.0])[:2]
    np.testing.assert_allclose(through_enu, through_frd, atol=1e-9)


@given(vectors, angles)
def test_rotating_back_restores(vector, angle):
    assert rotate(rotate(vector, angle), -angle) == pytest.approx(vector, abs=1e-9)


@given(angles, st.floats(-1.4, 1.4), angles)
def test_yaw_of_a_quaternion(yaw, pitch, roll):
    x, y, z, w = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
    assert wrap(yaw_of((w, x, y, z)) - yaw) == pytest.approx(0.0, abs=1e-6)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_lie_in_the_half_open_turn(angle):
    turned = wrap(angle)
    assert -math.pi < turned <= math.pi
    assert math.cos(turned) == pytest.approx(math.cos(angle), abs=1e-9)
