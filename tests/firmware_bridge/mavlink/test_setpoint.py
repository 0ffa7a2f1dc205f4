import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState
from edge_runtime.motion.models import PointAcceleration, PointForce, Unicycle
from firmware_bridge.guard.link import Setpoint, SetpointLimits
from firmware_bridge.kinematics.base import Base, turning
from firmware_bridge.mavlink.messages import Target
from firmware_bridge.mavlink.profiles import SetpointKind
from firmware_bridge.mavlink.setpoint import Follower, clamp

DRAGGED = PointForce(mass_kg=2.0, drag=0.25, dt_s=0.1).at_period(0.02)
FREE = PointForce(mass_kg=1.0, drag=0.0, dt_s=0.02)
LIMITS = SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0))
STRAIGHT = Base("differential")
AHEAD = Base("differential", sideways="lookahead", lookahead_m=0.2, max_yaw_rad_s=100.0)
REST = (0.0, 0.0)

actions = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


def follower(motion, dynamics=DRAGGED, wheels=STRAIGHT, limits=LIMITS):
    return Follower(motion, dynamics, limits, wheels)


def setpoint(action, velocity=(9.0, 9.0)):
    return Setpoint(1, 0.0, action, velocity)


def state(velocity=REST, heading=0.0):
    return RobotState(0, 0.0, REST, velocity, heading)


def test_velocity_follows_the_manifests_dynamics_from_command_to_command():
    """Drag has more leak than the bridge's own, so a constant action ends at the dynamics' own speed."""
    px4 = follower(SetpointKind.VELOCITY)
    for _ in range(500):
        target = px4.follow(setpoint((0.5, 0.0)), state())
    preview = DRAGGED.preview(1)
    final = preview.velocity_gain * 0.5 / (1.0 - preview.velocity_decay)
    assert target.velocity_m_s == pytest.approx((0.0, final, 0.0))
    assert (target.frame, target.type_mask) == (1, 0xDC7)


def test_without_drag_the_leak_bounds_what_a_small_bias_adds_up_to():
    px4 = follower(SetpointKind.VELOCITY, FREE)
    for _ in range(2000):
        target = px4.follow(setpoint((0.1, 0.0)), state())
    assert target.velocity_m_s[1] == pytest.approx(0.1 / 0.5, rel=0.02)


@given(st.lists(actions, min_size=1, max_size=60))
def test_integrated_velocity_never_passes_the_limit(commands):
    px4 = follower(SetpointKind.VELOCITY, FREE)
    for action in commands:
        target = px4.follow(setpoint(action), state())
        assert math.hypot(*target.velocity_m_s) <= LIMITS.speed_m_s * (1 + 1e-12)


def test_integration_starts_from_the_measured_velocity():
    px4 = follower(SetpointKind.VELOCITY)
    target = px4.follow(setpoint((1e-9, 0.0)), state(velocity=(0.4, 0.0)))
    assert target.velocity_m_s[1] == pytest.approx(0.4 * DRAGGED.preview(1).velocity_decay)


def test_the_zero_command_is_zero_velocity_and_forgets():
    drone = follower(SetpointKind.VELOCITY)
    for _ in range(50):
        drone.follow(setpoint((1.0, 1.0)), state())
    assert drone.follow(setpoint(REST, REST), state(velocity=(0.5, 0.5))) == Target(1, 0xDC7)
    after = drone.follow(setpoint((1e-9, 0.0)), state())
    assert math.hypot(*after.velocity_m_s) < 1e-6


def test_zero_action_in_motion_is_no_stop():
    """Without drag a robot that coasts gets no action and keeps its velocity."""
    px4 = follower(SetpointKind.VELOCITY, FREE)
    for _ in range(20):
        px4.follow(setpoint((1.0, 0.0)), state())
    assert px4.follow(setpoint(REST, (0.4, 0.0)), state()).velocity_m_s[1] > 0.3


def test_in_space_up_is_a_negative_velocity_on_the_wire():
    flying = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.02, dims=3)
    limits = SetpointLimits(1.0, (-1.0,) * 3, (1.0,) * 3, dims=3)
    drone = follower(SetpointKind.VELOCITY, flying, limits=limits)
    own = RobotState(0, 0.0, (0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
    target = drone.follow(Setpoint(1, 0.0, (0.0, 0.5, 1.0), (0.0, 0.01, 0.02)), own)
    assert target.velocity_m_s == pytest.approx((0.01, 0.0, -0.02))
    assert (target.frame, target.type_mask) == (1, 0xDC7)
    assert drone.hold() == Target(1, 0xDC7)


def test_a_policy_that_turns_its_drone_commands_the_yaw_rate_within_its_limit():
    rigid = PointAcceleration(drag=0.0, dt_s=0.02, angular=True)
    limits = SetpointLimits(1.0, (-1.0,) * 3, (1.0,) * 3, yaw_rate_rad_s=0.5)
    drone = follower(SetpointKind.VELOCITY, rigid, limits=limits)
    for _ in range(100):
        target = drone.follow(Setpoint(1, 0.0, (0.0, 0.0, 1.0), (0.0, 0.0), 0.1), state())
        assert abs(target.yaw_rate_rad_s) <= 0.5
    assert (target.frame, target.type_mask, target.yaw_rate_rad_s) == (1, 0x5C7, -0.5)
    assert drone.hold() == Target(1, 0x5C7)
    assert drone.follow(Setpoint(1, 0.0, (0.0, 0.0, 1.0), (0.0, 0.0), 0.1), state()).yaw_rate_rad_s > -0.03


class TestRover:
    @given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-math.pi, math.pi))
    def test_a_unicycle_policys_speed_and_yaw_rate_reach_the_wheels(self, speed, turn, heading):
        limits = SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0), yaw_rate_rad_s=2.0)
        wheels = turning(AHEAD)
        rover = follower(SetpointKind.FORWARD_AND_YAW_RATE, Unicycle(dt_s=0.02), wheels, limits)
        command = Setpoint(1, 0.0, (speed, turn), (speed, 0.0), turn)
        target = rover.follow(command, state(heading=heading))
        assert target.velocity_m_s == pytest.approx((speed, 0.0, 0.0))
        assert target.yaw_rate_rad_s == pytest.approx(-turn)

    def test_forward_along_the_heading(self):
        rover = follower(SetpointKind.FORWARD_AND_YAW_RATE, FREE)
        target = rover.follow(setpoint((0.0, 0.5)), state(heading=math.pi / 2))
        assert (target.frame, target.type_mask) == (8, 0x5C7)
        assert target.velocity_m_s == pytest.approx((0.5 * 0.02 * 0.99, 0.0, 0.0))
        assert target.yaw_rate_rad_s == 0.0

    @given(actions, st.floats(-math.pi, math.pi))
    def test_the_wire_never_carries_a_lateral_velocity(self, action, heading):
        rover = follower(SetpointKind.FORWARD_AND_YAW_RATE, FREE, AHEAD)
        assert rover.follow(setpoint(action), state(heading=heading)).velocity_m_s[1] == 0.0

    @given(actions, st.floats(-math.pi, math.pi))
    def test_the_point_ahead_moves_as_commanded(self, action, heading):
        rover = follower(SetpointKind.FORWARD_AND_YAW_RATE, FREE, AHEAD)
        target = rover.follow(setpoint(action), state(heading=heading))
        expected = follower(SetpointKind.VELOCITY, FREE).follow(setpoint(action), state(heading=heading))
        forward, counter_clockwise = target.velocity_m_s[0], -target.yaw_rate_rad_s
        c, s = math.cos(heading), math.sin(heading)
        east = forward * c - 0.2 * counter_clockwise * s
        north = forward * s + 0.2 * counter_clockwise * c
        assert (north, east, 0.0) == pytest.approx(expected.velocity_m_s, abs=1e-9)

    def test_turning_left_is_a_negative_yaw_rate_on_the_wire(self):
        rover = follower(SetpointKind.FORWARD_AND_YAW_RATE, FREE, AHEAD)
        assert rover.follow(setpoint((0.0, 1.0)), state(heading=0.0)).yaw_rate_rad_s < 0.0

    def test_sideways_without_a_point_ahead_is_refused(self):
        rover = follower(SetpointKind.FORWARD_AND_YAW_RATE, FREE)
        with pytest.raises(BridgeError, match="sideways"):
            rover.follow(setpoint((0.0, 1.0)), state(heading=0.0))

    def test_holding_commands_zero_speed_and_zero_turn(self):
        assert follower(SetpointKind.FORWARD_AND_YAW_RATE).hold() == Target(8, 0x5C7)


@given(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), st.floats(0.1, 10.0))
def test_clamp_keeps_the_direction(vector, length):
    x, y = clamp(vector, length)
    assert math.hypot(x, y) == pytest.approx(min(length, math.hypot(*vector)))
    assert x * vector[1] == pytest.approx(y * vector[0], abs=1e-9)
