"""Attraction: the whole team is drawn alike, at most so strongly, and stays where the object is."""

import numpy as np
import pytest

from edge_runtime.messages import RobotState, Teammate, TeamState, TrackedObject
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import Attraction

PREVIEW = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1).preview(4)
PLACES = np.array([(0.0, 0.1), (0.3, -0.2), (-0.6, 0.4)])
MIDDLE = PLACES.mean(0)


def slope_of(robot, there, pull=0.2):
    """The force (2,) that one robot of the team is drawn by, and its cost."""
    states = [RobotState(n, 0.0, tuple(place), (0.0, 0.0)) for n, place in enumerate(PLACES.tolist())]
    mates = tuple(Teammate(state) for state in states if state.robot_id != robot)
    load = TrackedObject("load", 0.0, tuple(there), (0.0, 0.0))
    outlook = look_ahead(TeamState(states[robot], mates, tracked=(load,)), PREVIEW)
    slope = Attraction(object="load", pull=pull).evaluate(outlook.drift, outlook)
    return -PREVIEW.position_gain * np.array([slope.d_x, slope.d_y]), slope.cost


@pytest.mark.parametrize("robot", range(3))
def test_every_robot_is_drawn_as_the_middle_is(robot):
    far = MIDDLE + np.array([3.0, -4.0])
    force, _ = slope_of(robot, far)
    np.testing.assert_allclose(force, 0.2 * np.array([0.6, -0.8]))
    weaker, _ = slope_of(robot, far, pull=0.05)
    np.testing.assert_allclose(weaker, 0.25 * force)


@pytest.mark.parametrize("robot", range(3))
def test_a_team_that_is_there_is_left_alone(robot):
    force, cost = slope_of(robot, MIDDLE)
    np.testing.assert_allclose([*force, cost], 0.0, atol=1e-12)


def test_near_by_all_robots_together_take_the_middle_there_in_one_newton_step():
    near = MIDDLE + np.array([0.001, 0.002])
    moves = [PREVIEW.position_gain * slope_of(robot, near)[0] for robot in range(3)]
    np.testing.assert_allclose(MIDDLE + np.mean(moves, 0), near)
