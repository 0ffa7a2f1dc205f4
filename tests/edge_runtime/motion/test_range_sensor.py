"""What in a range sensor's readings is an obstacle: neither teammates nor the same thing twice."""

import math

import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.errors import PolicyError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.motion.point import PointForce
from edge_runtime.motion.range_sensor import APART, EXPLAINED_M
from edge_runtime.objectives import ObstacleMargin

RADIUS_M = MANIFEST.body.radius_m
MANY = replace(MANIFEST.body, lidar_rays=360, lidar_range_m=1.0).sensor()
coordinate = st.floats(-1.0, 1.0)
places = st.lists(st.tuples(coordinate, coordinate), max_size=5)


def state(robot, position, velocity=(0.0, 0.0)):
    return RobotState(robot, 0.0, position, velocity)


def seen(sensor, own, mates, discs=()):
    """The view of a robot whose sensor sees its mates and other discs."""
    team = TeamState(state(0, own), tuple(Teammate(state(1 + i, mate)) for i, mate in enumerate(mates)))
    around = [(*mate, sensor.radius_m) for mate in mates] + list(discs)
    return replace(team, ranges_m=tuple(sensor.readings(own, around)))


@given(own=st.tuples(coordinate, coordinate), mates=places)
@settings(max_examples=100, deadline=None)
def test_teammates_explain_all_that_is_seen_of_them(own, mates):
    apart = [mate for mate in mates if math.dist(own, mate) > RADIUS_M]
    assert MANY.obstacles(seen(MANY, own, apart)) == ()


@given(disc=st.tuples(st.floats(0.3, 0.9), st.floats(-math.pi, math.pi)), mates=places)
@settings(max_examples=100, deadline=None)
def test_the_nearest_point_of_an_obstacle_is_found_whoever_is_near(disc, mates):
    distance, angle = disc
    centre = (distance * math.cos(angle), distance * math.sin(angle))
    far = [
        m
        for m in mates
        if math.dist(m, centre) > 2 * RADIUS_M + 2 * EXPLAINED_M and math.hypot(*m) > distance
    ]
    (nearest, *others) = MANY.obstacles(seen(MANY, (0.0, 0.0), far, [(*centre, RADIUS_M)]))
    assert math.hypot(*nearest) == pytest.approx(distance - RADIUS_M, abs=5e-3)
    assert all(math.hypot(*other) >= math.hypot(*nearest) for other in others)


def test_a_wall_counts_once_however_many_rays_it_takes():
    """A full turn of rays that all end near by leaves eight points at most, none near another's direction."""
    readings = tuple(np.random.default_rng(0).uniform(0.2, 0.4, 360).tolist())
    points = MANY.obstacles(TeamState(state(0, (0.5, 0.5)), ranges_m=readings))
    assert 4 <= len(points) <= 8
    rays = [np.array(point) - 0.5 for point in points]
    rays = [ray / np.linalg.norm(ray) for ray in rays]
    assert max(a @ b for a in rays for b in rays if a is not b) <= APART + 1e-9


def test_a_teammate_explains_as_far_as_it_may_have_moved():
    team = seen(MANY, (0.0, 0.0), [], [(0.5, 0.0, RADIUS_M)])
    (mate,) = (Teammate(state(1, (0.2, 0.0), (1.0, 0.0)), age_s=age) for age in [0.2])
    assert MANY.obstacles(replace(team, teammates=(mate,))) == ()
    assert MANY.obstacles(replace(team, teammates=(replace(mate, age_s=0.0),)))[0] == pytest.approx(
        (0.4, 0.0)
    )


def test_computed_ranges_show_no_obstacles_and_a_wrong_number_of_readings_is_refused():
    team = TeamState(state(0, (0.0, 0.0)), (Teammate(state(1, (0.3, 0.0))),))
    assert MANY.obstacles(team) == ()
    with pytest.raises(PolicyError, match="got 3 ranges, the policy's sensor has 360 rays"):
        MANY.obstacles(replace(team, ranges_m=(0.1,) * 3))


def test_in_space_the_rays_see_what_a_plane_at_the_robots_height_cuts_of_the_others():
    own = state(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    for above, cut in ((0.0, RADIUS_M), (0.6 * RADIUS_M, 0.8 * RADIUS_M), (1.1 * RADIUS_M, 0.0)):
        mate = Teammate(state(1, (0.5, 0.0, 1.0 + above), (0.0, 0.0, 0.0)))
        first = MANY.read(TeamState(own, (mate,)))[0]
        assert first == pytest.approx(0.5 - cut if cut else MANY.range_m)
    real = TeamState(own, (mate,), ranges_m=(0.5, *(1.0,) * 359))
    assert MANY.obstacles(replace(real, teammates=())) == ((0.5, 0.0),)
    assert MANY.obstacles(real) == ()


def test_a_reading_below_zero_is_at_the_robot():
    readings = (-0.05, *(1.0,) * 359)
    assert MANY.obstacles(TeamState(state(0, (0.2, 0.1)), ranges_m=readings)) == ((0.2, 0.1),)


def test_the_cost_is_half_the_squared_action_that_restores_the_margin():
    objective = ObstacleMargin(distance_m=0.3, buffer_m=0.0, look_ahead=1)
    preview = PointForce(1.0, 0.0, 0.1).preview(1)
    outlook = look_ahead(TeamState(state(0, (0.0, 0.0))), preview, ((0.2, 0.0),))
    slope = objective.evaluate(outlook.drift, outlook)
    assert slope.cost == pytest.approx(0.5 * (0.1 / preview.position_gain) ** 2)
    moved = outlook.drift._replace(x=-slope.d_x * preview.position_gain**2)
    assert objective.evaluate(moved, outlook).cost == pytest.approx(0.0, abs=1e-12)
    at_it = objective.evaluate(outlook.drift._replace(x=0.2), outlook)
    assert math.isfinite(at_it.d_x)
    assert at_it.d_x != 0.0
