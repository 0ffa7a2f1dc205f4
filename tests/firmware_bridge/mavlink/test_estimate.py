import math

import pytest
from scipy.spatial.transform import Rotation

from firmware_bridge.mavlink.clock import Clock
from firmware_bridge.mavlink.estimate import Estimate
from firmware_bridge.mavlink.messages import Attitude, LocalPosition, Odometry, TimeSync


@pytest.fixture
def clock():
    clock = Clock()
    clock.on_answer(TimeSync(1, 10_000_000_000), 10.0)
    return clock


def estimate(clock, origin=(0.0, 0.0), ahead=0.0):
    return Estimate(3, clock, origin, ahead)


def test_position_velocity_and_heading_in_the_teams_axes(clock):
    robot = estimate(clock, origin=(100.0, 200.0))
    robot.on_attitude(Attitude(2.0, math.pi / 2, 0.0))
    robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.25, 0.5)), 12.01)
    state = robot.state
    assert (state.robot_id, state.stamp_s) == (3, pytest.approx(12.0))
    assert state.position_m == (102.0, 201.0)
    assert state.velocity_m_s == (0.5, 0.25)
    assert state.heading_rad == pytest.approx(0.0)


def test_odometry_brings_body_velocity_and_attitude(clock):
    robot = estimate(clock)
    x, y, z, w = Rotation.from_euler("ZYX", [math.pi / 2, 0.0, 0.0]).as_quat()
    robot.on_odometry(Odometry(2.0, (1.0, 2.0), (0.5, 0.25), (w, x, y, z), 0.0, 0), 12.01)
    assert robot.state.position_m == (2.0, 1.0)
    # Facing east: forward is east, right is south.
    assert robot.state.velocity_m_s == pytest.approx((0.5, -0.25))
    assert robot.state.heading_rad == pytest.approx(0.0)


def test_a_point_ahead_turns_with_the_robot(clock):
    robot = estimate(clock, ahead=0.5)
    robot.on_attitude(Attitude(2.0, 0.0, 0.2))
    robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.3, 0.0)), 12.01)
    # Facing north and turning clockwise: the point is north of the axle and swings east.
    assert robot.state.position_m == pytest.approx((2.0, 1.5))
    assert robot.state.velocity_m_s == pytest.approx((0.1, 0.3))


def test_no_state_without_heading_or_clock(clock):
    robot = estimate(clock)
    robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.0, 0.0)), 12.0)
    assert robot.state is None
    unsynchronised = estimate(Clock())
    unsynchronised.on_attitude(Attitude(2.0, 0.0, 0.0))
    unsynchronised.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.0, 0.0)), 12.0)
    assert unsynchronised.state is None


def test_a_heading_of_another_time_is_not_used(clock):
    robot = estimate(clock)
    robot.on_attitude(Attitude(1.0, 0.0, 0.0))
    robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.0, 0.0)), 12.0)
    assert robot.state is None


def test_older_positions_do_not_replace_newer_ones_and_none_is_of_the_future(clock):
    robot = estimate(clock)
    robot.on_attitude(Attitude(2.0, 0.0, 0.0))
    robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.0, 0.0)), 11.9)
    assert robot.state.stamp_s == 11.9
    robot.on_local_position(LocalPosition(1.8, (9.0, 9.0), (0.0, 0.0)), 12.0)
    assert robot.state.position_m == (2.0, 1.0)


def test_in_space_up_is_minus_down_and_tilt_is_turned_back(clock):
    robot = Estimate(3, clock, (100.0, 200.0), 0.0, dims=3)
    robot.on_attitude(Attitude(2.0, math.pi / 2, 0.25))
    robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.25, 0.5), -3.0, 0.75), 12.01)
    assert robot.state.position_m == (102.0, 201.0, 3.0)
    assert robot.state.velocity_m_s == (0.5, 0.25, -0.75)
    assert robot.state.yaw_rate_rad_s == -0.25
    tilted = Rotation.from_euler("ZYX", [0.7, 0.2, -0.3])
    x, y, z, w = tilted.as_quat()
    robot.on_odometry(Odometry(2.1, (1.0, 2.0), (0.5, 0.25), (w, x, y, z), 0.1, 0, -4.0, 0.125), 12.11)
    north, east, down = tilted.apply([0.5, 0.25, 0.125])
    assert robot.state.velocity_m_s == pytest.approx((east, north, -down))
    assert robot.state.position_m == (102.0, 201.0, 4.0)


def test_a_height_that_is_none_matters_in_space_alone(clock):
    for dims in (2, 3):
        robot = Estimate(3, clock, (0.0, 0.0), 0.0, dims=dims)
        robot.on_attitude(Attitude(2.0, 0.0, 0.0))
        robot.on_local_position(LocalPosition(2.0, (1.0, 2.0), (0.0, 0.0), math.nan, 0.0), 12.01)
        assert (robot.state is None) == (dims == 3)
