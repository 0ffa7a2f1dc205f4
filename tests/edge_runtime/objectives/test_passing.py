"""Two discs that must change places along x: order alone jams them, agreed sides let them pass."""

import math

import numpy as np
import pytest
from guidance_cases import gaussian_flow, guide_for
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.guidance.flow import guided_action
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import Passing, SpatialOrder

DYNAMICS = PointForce(mass_kg=1 / 0.7, drag=0.25, dt_s=0.1)
RADIUS_M = 0.03
ORDER = SpatialOrder(order=(1, 0), gap_m=0.08, pull=2.0)
STILL = gaussian_flow(0.1, np.zeros(2), 5)
"""A policy that wants nothing; from a start of zero its action is zero."""


def swap(objectives, places, steps=150):
    """Drive two discs under guidance; (steps + 1, 2, 2) positions in metres. Their contact is inelastic."""
    guide, preview = (
        guide_for(objectives, reach=0.5),
        DYNAMICS.preview(1),
    )
    position, velocity, path = np.array(places, float), np.zeros((2, 2)), [np.array(places, float)]
    action = np.zeros((2, 2))
    for _ in range(steps):
        states = [
            RobotState(i, 0.0, tuple(p), tuple(v))
            for i, (p, v) in enumerate(zip(position.tolist(), velocity.tolist(), strict=True))
        ]
        intended = [tuple(a) for a in action.tolist()]
        views = [TeamState(states[i], (Teammate(states[1 - i], intended[1 - i]),)) for i in range(2)]
        sampled = [guided_action(STILL, np.zeros((1, 1), np.float32), view, guide) for view in views]
        action = np.clip([sample.action for sample in sampled], -1.0, 1.0)
        position = position + preview.position_decay * velocity + preview.position_gain * action
        velocity = preview.velocity_decay * velocity + preview.velocity_gain * action
        position, velocity = part(position, velocity)
        path.append(position)
    return np.array(path)


def part(position, velocity):
    """Move overlapping discs apart along their centres, and end their approach."""
    apart = position[1] - position[0]
    distance = np.linalg.norm(apart)
    if distance >= 2 * RADIUS_M:
        return position, velocity
    normal = apart / distance
    position = position + np.outer([-0.5, 0.5], (2 * RADIUS_M - distance) * normal)
    approach = min(0.0, (velocity[1] - velocity[0]) @ normal)
    return position, velocity - np.outer([-0.5, 0.5], approach * normal)


def in_order(path):
    return path[-1, 0, 0] - path[-1, 1, 0] >= ORDER.gap_m - 0.02


def test_order_alone_jams_two_robots_that_meet_head_on():
    path = swap([ORDER], [(-0.2, 0.0), (0.2, 0.0)])
    assert not in_order(path)
    assert path[-1, 1, 0] - path[-1, 0, 0] == pytest.approx(2 * RADIUS_M, abs=1e-3)
    assert np.abs(path[..., 1]).max() == 0.0


def test_passing_lets_them_by_below():
    path = swap([ORDER, Passing(order=ORDER.order)], [(-0.2, 0.0), (0.2, 0.0)])
    assert in_order(path)
    assert np.linalg.norm(path[:, 0] - path[:, 1], axis=-1).min() >= 2 * RADIUS_M - 1e-9
    assert path[:, 0, 1].min() < -RADIUS_M  # robot 0 stands later in the order
    assert math.isclose(path[:, 1, 1].min(), 0.0, abs_tol=RADIUS_M)


@settings(max_examples=15, deadline=None)
@given(y=st.tuples(*[st.floats(-0.05, 0.05)] * 2), x=st.floats(0.04, 0.3))
def test_passing_lets_them_by_from_wherever_they_meet(y, x):
    assert in_order(swap([ORDER, Passing(order=ORDER.order)], [(-x, y[0]), (x, y[1])]))


def test_robots_in_order_are_left_alone():
    path = swap([Passing(order=ORDER.order)], [(0.05, 0.0), (-0.05, 0.0)])
    assert np.ptp(path, axis=0).max() == 0.0
