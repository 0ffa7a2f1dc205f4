"""The observation against VMAS's own navigation scenario."""

import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from observation_scenes import ROBOTS, TEAMS, scenes, vmas_observations

from edge_runtime.errors import PolicyError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.observation import GoalOffset, Position
from edge_runtime.observation.observer import Observer


def team_state(position, velocity, robot):
    states = [
        RobotState(i, 0.0, tuple(p), tuple(v))
        for i, (p, v) in enumerate(zip(position.tolist(), velocity.tolist(), strict=True))
    ]
    return TeamState(states[robot], tuple(Teammate(s) for i, s in enumerate(states) if i != robot))


@pytest.mark.parametrize("robot", range(ROBOTS))
def test_an_observation_is_vmas(robot):
    (position, velocity, goal), reference = scenes(), vmas_observations()
    for row in range(TEAMS):
        observer = Observer(MANIFEST, tuple(goal[row, robot].tolist()))
        found = observer.observe(team_state(position[row], velocity[row], robot))
        np.testing.assert_allclose(found[0], reference[robot, row], atol=1e-6)


def test_scenes_reach_into_discs():
    """The scenes above do contain rays that start inside a disc, and free ones."""
    proximity = vmas_observations()[..., 6:]
    assert (proximity > MANIFEST.body.lidar_range_m).sum() > 50
    assert (proximity == 0).sum() > 50


def test_fields_follow_the_manifest():
    fields = (GoalOffset("to_go", 2, "m"), Position("place", 2, "m"))
    observer = Observer(replace(MANIFEST, observation=fields), (1.0, 2.0))
    own = RobotState(0, 0.0, (0.25, 0.5), (0.0, 0.0))
    np.testing.assert_array_equal(observer.observe(TeamState(own)), [[-0.75, -1.5, 0.25, 0.5]])


def test_a_real_sensor_takes_the_place_of_the_computed_one():
    observer = Observer(MANIFEST, (0.0, 0.0))
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0)))
    found = observer.observe(replace(team, ranges_m=(0.1,) * 12))
    np.testing.assert_allclose(found[0, 6:], 0.25, atol=1e-7)
    with pytest.raises(PolicyError, match="got 3 ranges, the policy's sensor has 12 rays"):
        observer.observe(replace(team, ranges_m=(0.1,) * 3))


@given(
    x=st.floats(-1, 1),
    y=st.floats(-1, 1),
    discs=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), max_size=6),
)
@settings(max_examples=100, deadline=None)
def test_readings_never_exceed_the_range_nor_depend_on_the_order(x, y, discs):
    body = MANIFEST.body
    found = body.sensor().readings((x, y), [(*disc, body.radius_m) for disc in discs])
    assert found == body.sensor().readings((x, y), [(*disc, body.radius_m) for disc in discs[::-1]])
    assert all(-MANIFEST.body.radius_m <= reading <= MANIFEST.body.lidar_range_m for reading in found)


def test_eased_ranges_are_longer_up_to_the_sensors_unless_they_are_real():
    observer, own = Observer(MANIFEST, (0.0, 0.0)), RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0))
    team = TeamState(own, (Teammate(RobotState(1, 0.0, (0.3, 0.0), (0.0, 0.0))),))
    near = observer.observe(team)[0, 6:].copy()
    eased = observer.observe(team, ease_m=0.1)[0, 6:]
    assert near.max() == pytest.approx(0.15)
    np.testing.assert_allclose(eased, np.maximum(near - 0.1, 0.0), atol=1e-6)
    real = observer.observe(replace(team, ranges_m=(0.1,) * 12), ease_m=0.1)[0, 6:]
    np.testing.assert_allclose(real, 0.25, atol=1e-6)
