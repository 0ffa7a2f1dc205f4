"""Whatever comes, the command is finite and within limits."""

import math

import pytest
from bundles import MANIFEST
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.control.limits import RobotLimits, first_command, limited
from edge_runtime.messages import Command, GuidedAction, RobotState, Teammate, TeamState

LIMITS = RobotLimits(
    low=(-1.0, -0.5),
    high=(1.0, 2.0),
    preview=MANIFEST.motion.preview(1),
    max_step=math.inf,
    max_state_age_s=0.1,
)
OWN = RobotState(3, 10.0, (0.1, 0.2), (0.4, -0.4))
TEAM = TeamState(OWN)
BEFORE = first_command(3, 2, 2)

anything = st.floats(allow_nan=True, allow_infinity=True)
vectors = st.tuples(anything, anything)


def zero_because(command: Command) -> str:
    assert command.action == command.velocity_m_s == (0.0, 0.0)
    return command.stop_reason


@given(
    action=vectors, position=vectors, velocity=vectors, mate=vectors, stamp=anything, step=st.floats(0.01, 10)
)
def test_commands_are_finite_and_within_limits(action, position, velocity, mate, stamp, step):
    own = RobotState(3, stamp, position, velocity)
    team = TeamState(own, (Teammate(RobotState(1, 10.0, mate, mate)),))
    command = limited(GuidedAction(action, 10), team, BEFORE, replace(LIMITS, max_step=step), 10.0)
    inside = zip(command.action, LIMITS.low, LIMITS.high, strict=True)
    assert all(low <= value <= high and abs(value) <= step for value, low, high in inside)
    assert all(math.isfinite(value) for value in command.velocity_m_s)
    trusted = [*action, *position, *velocity, *mate, stamp]
    assert bool(command.stop_reason) or all(math.isfinite(value) for value in trusted)


def test_actions_are_clamped_per_axis():
    assert limited(GuidedAction((5.0, -5.0), 10), TEAM, BEFORE, LIMITS, 10.0).action == (1.0, -0.5)


def test_velocity_setpoint_is_the_one_that_the_action_leads_to():
    command = limited(GuidedAction((0.5, 1.0), 10), TEAM, BEFORE, LIMITS, 10.0)
    assert command.velocity_m_s == pytest.approx((0.75 * 0.4 + 0.1 * 0.5, -0.75 * 0.4 + 0.1 * 1.0))


def test_slew_is_limited_from_the_last_command():
    before = Command(3, 7, 9.9, (0.5, 0.0), (0.0, 0.0))
    command = limited(GuidedAction((-1.0, 0.1), 10), TEAM, before, replace(LIMITS, max_step=0.2), 10.0)
    assert command.action == pytest.approx((0.3, 0.1))
    assert (command.robot_id, command.sequence, command.stamp_s) == (3, 8, 10.0)


def test_a_fault_stops():
    command = limited(GuidedAction((1.0, 1.0), 0, fault="no gradient"), TEAM, BEFORE, LIMITS, 10.0)
    assert zero_because(command) == "no gradient"


@pytest.mark.parametrize(
    "now, stops", [(10.0, False), (10.1 - 1e-9, False), (10.101, True), (math.nan, True)]
)
def test_a_stale_state_stops(now, stops):
    command = limited(GuidedAction((1.0, 1.0), 10), TEAM, BEFORE, LIMITS, now)
    assert command.stop_reason.startswith("the robot's own state is") == stops
    assert (command.action == (0.0, 0.0)) == stops


@pytest.mark.parametrize(
    ("spoilt", "number"), [("position_m", math.nan), ("velocity_m_s", math.nan), ("position_m", 1e300)]
)
def test_a_teammate_that_cannot_be_there_stops(spoilt, number):
    mate = replace(RobotState(5, 10.0, (1.0, 1.0), (0.0, 0.0)), **{spoilt: (0.0, number)})
    team = TeamState(OWN, (Teammate(mate),))
    command = limited(GuidedAction((1.0, 1.0), 10), team, BEFORE, LIMITS, 10.0)
    assert zero_because(command) == "the state of robot 5 is not finite, or absurd"


def test_a_view_that_is_at_fault_stops():
    team = TeamState(OWN, fault="no teammate was heard for 1 s")
    command = limited(GuidedAction((1.0, 1.0), 10), team, BEFORE, LIMITS, 10.0)
    assert zero_because(command) == "no teammate was heard for 1 s"
