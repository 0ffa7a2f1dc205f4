"""Whatever comes, the command is finite and within limits."""

import math

import pytest
from bundles import MANIFEST
from hypothesis import given
from hypothesis import strategies as st
from motion_models import moving
from msgspec.structs import replace

from edge_runtime.control.limits import RobotLimits, first_command, limited, robot_limits
from edge_runtime.messages import Command, GuidedAction, RobotState, Teammate, TeamState
from edge_runtime.policy.manifest import ActionField

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


@given(moving(), st.floats(0.01, 5.0), st.floats(0.0, 2.0))
def test_commands_of_every_body_have_its_components_within_its_limits(case, fastest, turning):
    model, own, action = case
    action = tuple(min(max(value, -1.0), 2.0) for value in action)
    manifest = replace(
        MANIFEST,
        motion=model,
        action=tuple(ActionField("a", "1", -1.0, 2.0) for _ in range(model.action_dim)),
    )
    limits = robot_limits(
        manifest,
        model.dt_s,
        max_step=math.inf,
        max_state_age_s=1.0,
        max_speed_m_s=fastest,
        max_unfamiliar_s=math.inf,
        max_yaw_rate_rad_s=turning,
    )
    before = first_command(0, model.action_dim, model.dims)
    command = limited(GuidedAction(action, 10), TeamState(own), before, limits, own.stamp_s)
    assert not command.stop_reason
    assert command.action == pytest.approx(action)
    expected = model.predict(own, action)
    assert math.hypot(*command.velocity_m_s) <= fastest * (1 + 1e-9)
    if math.hypot(*expected.velocity_m_s(model.dims)) <= fastest:
        assert command.velocity_m_s == pytest.approx(expected.velocity_m_s(model.dims))
    assert command.yaw_rate_rad_s == pytest.approx(min(max(expected.yaw_rate, -turning), turning))
    stopped = limited(GuidedAction(action, 0, fault="no"), TeamState(own), command, limits, own.stamp_s)
    assert (len(stopped.action), len(stopped.velocity_m_s)) == (model.action_dim, model.dims)
    assert not any((*stopped.action, *stopped.velocity_m_s, stopped.yaw_rate_rad_s))


def test_states_of_another_space_and_actions_of_another_body_stop():
    flying = RobotState(3, 10.0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    command = limited(GuidedAction((1.0, 1.0), 10), TeamState(flying), BEFORE, LIMITS, 10.0)
    assert zero_because(command) == "the robot's own position has 3 components, its policy needs 2"
    for mate in (Teammate(replace(flying, robot_id=1)), Teammate(replace(OWN, robot_id=1), (0.0,) * 3)):
        command = limited(GuidedAction((1.0, 1.0), 10), TeamState(OWN, (mate,)), BEFORE, LIMITS, 10.0)
        assert zero_because(command) == "robot 1 moves or acts in other dimensions: it runs another policy"
    spinning = replace(OWN, yaw_rate_rad_s=math.nan)
    command = limited(GuidedAction((1.0, 1.0), 10), TeamState(spinning), BEFORE, LIMITS, 10.0)
    assert "not finite" in zero_because(command)
