"""The last word before the bridge: a guided action becomes a command that is finite and within limits.

Whatever cannot be trusted stops the robot in the same tick: a faulty or non-finite action, a non-finite
state, an own state that is too old, a view of the team that says so itself.
"""

import math

import msgspec

from edge_runtime.common.bounds import is_motion
from edge_runtime.messages import Command, GuidedAction, RobotState, TeamState, Vector
from edge_runtime.motion.prediction import Preview
from edge_runtime.observation.familiarity import FAMILIAR, Unfamiliar
from edge_runtime.policy.manifest import Manifest


class RobotLimits(msgspec.Struct, frozen=True, gc=False):
    """What one robot may be commanded."""

    low: Vector
    """Least action per component, in the policy's action units."""
    high: Vector
    """Greatest action per component."""
    preview: Preview
    """The robot's motion over one control period, for the setpoints of velocity and yaw rate."""
    max_step: float
    """Greatest change of each action component from one command to the next; may be infinite."""
    max_state_age_s: float
    max_speed_m_s: float = math.inf
    """Greatest velocity setpoint; a longer one is shortened, its direction kept."""
    max_unfamiliar_s: float = math.inf
    """For so long it may act on observations that training never had."""
    max_yaw_rate_rad_s: float = math.inf
    """Greatest magnitude of the yaw rate setpoint."""


def robot_limits(
    manifest: Manifest,
    period_s: float,
    max_step: float,
    max_state_age_s: float,
    max_speed_m_s: float,
    max_unfamiliar_s: float,
    max_yaw_rate_rad_s: float,
) -> RobotLimits:
    """Return the limits of a policy's robot at a control period; the others as in `RobotLimits`."""
    return RobotLimits(
        tuple(field.low for field in manifest.action),
        tuple(field.high for field in manifest.action),
        manifest.motion.at_period(period_s).preview(1),
        max_step,
        max_state_age_s,
        max_speed_m_s,
        max_unfamiliar_s,
        max_yaw_rate_rad_s,
    )


def limited(
    guided: GuidedAction,
    team: TeamState,
    previous: Command,
    limits: RobotLimits,
    now_s: float,
    unfamiliar: Unfamiliar = FAMILIAR,
) -> Command:
    """Turn a guided action into this tick's command.

    Args:
        guided: the sampled action.
        team: the states that it was sampled from.
        previous: the command before this one.
        limits: the robot's limits.
        now_s: monotonic time.
        unfamiliar: what the action's observation had that training never had.

    Returns:
        A command whose action is clamped and slew-limited, with the velocity that it leads to; zero, with
        the reason, where something is wrong.
    """
    fault = guided.fault or team_fault(team, limits, now_s)
    if not fault and not _finite(guided.action):
        fault = "the action is not finite"
    if not fault and unfamiliar.field and unfamiliar.seconds >= limits.max_unfamiliar_s:
        longest = f"{limits.max_unfamiliar_s:g} s"
        fault = f"{unfamiliar.field} has been outside of all that the policy saw in training for {longest}"
    if fault:
        return stop_command(previous, fault, now_s)
    steps = zip(guided.action, previous.action, limits.low, limits.high, strict=True)
    action = tuple([_component(*step, limits.max_step) for step in steps])
    motion, most = limits.preview.predict(team.own, action), limits.max_yaw_rate_rad_s
    velocity = _shortened(motion.velocity_m_s(limits.preview.dims), limits.max_speed_m_s)
    turn = min(max(motion.yaw_rate, -most), most)
    return Command(team.own.robot_id, previous.sequence + 1, now_s, action, velocity, turn)


def stop_command(previous: Command, reason: str, now_s: float) -> Command:
    """The zero command that follows ``previous``."""
    return Command(
        previous.robot_id,
        previous.sequence + 1,
        now_s,
        (0.0,) * len(previous.action),
        (0.0,) * len(previous.velocity_m_s),
        stop_reason=reason,
    )


def first_command(robot_id: int, action_dim: int, dims: int) -> Command:
    """What counts as the command before the first: rest, of so many components."""
    return Command(robot_id, -1, 0.0, (0.0,) * action_dim, (0.0,) * dims)


def team_fault(team: TeamState, limits: RobotLimits, now_s: float) -> str:
    """Why no action may rest on these states; empty if one may."""
    dims, components, max_age_s = limits.preview.dims, len(limits.low), limits.max_state_age_s
    if not _usable(team.own):
        return "the robot's own state is not finite, or absurd"
    if len(team.own.position_m) != dims:
        return f"the robot's own position has {len(team.own.position_m)} components, its policy needs {dims}"
    if not abs(now_s - team.own.stamp_s) <= max_age_s:  # a state from the future is no better
        return f"the robot's own state is not of the last {max_age_s:g} s"
    for mate in team.teammates + team.silent:
        if not (_usable(mate.state) and _finite(mate.intended_action)):
            return f"the state of robot {mate.state.robot_id} is not finite, or absurd"
        if len(mate.state.position_m) != dims or len(mate.intended_action) != components:
            return f"robot {mate.state.robot_id} moves or acts in other dimensions: it runs another policy"
    return team.fault


def _component(wanted: float, last: float, low: float, high: float, max_step: float) -> float:
    stepped = min(max(wanted, last - max_step), last + max_step)
    return min(max(stepped, low), high)


def _shortened(velocity: Vector, max_speed: float) -> Vector:
    speed = math.hypot(*velocity)
    if speed <= max_speed:
        return velocity
    return tuple([component * max_speed / speed for component in velocity])


def _usable(state: RobotState) -> bool:
    turn = state.heading_rad + state.yaw_rate_rad_s
    return is_motion(state.position_m, state.velocity_m_s) and math.isfinite(turn)


def _finite(vector: Vector) -> bool:
    return math.isfinite(sum(vector))
