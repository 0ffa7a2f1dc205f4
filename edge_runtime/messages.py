"""The records that travel through one tick, from states to a command. SI units, monotonic stamps."""

from typing import Annotated

import msgspec

Vector2 = tuple[float, float]
Integer = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""A whole number as other programs and machines hold it, in 64 bits."""


class RobotState(msgspec.Struct, frozen=True, gc=False):
    """Where one robot is and how it moves, in the team's common frame."""

    robot_id: Integer
    stamp_s: float
    """Monotonic time of the measurement."""
    position_m: Vector2
    velocity_m_s: Vector2
    heading_rad: float = 0.0


class Teammate(msgspec.Struct, frozen=True, gc=False):
    """What a robot knows of a neighbour: its state, what it intends, and how old that is."""

    state: RobotState
    intended_action: Vector2 = (0.0, 0.0)
    """The action that the neighbour commanded last, in the policy's action units."""
    age_s: float = 0.0


class TeamState(msgspec.Struct, frozen=True):
    """One robot's view of the team in one tick."""

    own: RobotState
    teammates: tuple[Teammate, ...] = ()
    fault: str = ""
    """Why no action may rest on this view, such as a teammate silent for too long. Else empty."""
    ranges_m: tuple[float, ...] | None = None
    """What a real range sensor read, one a ray; None where ranges are computed from the teammates."""
    silent: tuple[Teammate, ...] = ()
    """Masked ones, at rest where they were last known to be: obstacles until they are heard again."""


class GuidedAction(msgspec.Struct, frozen=True, gc=False):
    """One sampled action and what happened on the way; see `edge_runtime.guidance.flow`."""

    action: Vector2
    steps: Integer
    """Euler steps completed; fewer than T if the deadline came first."""
    costs: tuple[float, ...] = ()
    """Each active objective's cost where it was evaluated last: the newest terminal estimate, or on the way
    of the correction at tau = 1."""
    projections: Integer = 0
    """Steps in which a projection changed the guidance."""
    fault: str = ""
    """Why the action must not be used: a non-finite observation, gradient or velocity. Else empty."""
    conflicts: tuple[Integer, ...] = ()
    """For each active objective, how often its descent direction opposed another one's, over all steps."""
    opposed: Integer = 0
    """Steps in which eq. 15 removed what opposed the nominal flow."""
    correction: Vector2 = (0.0, 0.0)
    """How far the finished action was moved at tau = 1; mode ``terminal`` only."""
    cut: bool = False
    """Whether the deadline came before the last step."""
    objective_failed: bool = False
    """Whether the fault is an objective's: it raised, or has no finite gradient."""


class Command(msgspec.Struct, frozen=True, gc=False):
    """One setpoint for the robot's base.

    Bases that take forces or accelerations use ``action``; bases that take velocities use
    ``velocity_m_s``, the velocity which the manifest's dynamics reach at the end of the period.
    """

    robot_id: Integer
    sequence: Integer
    stamp_s: float
    action: Vector2
    velocity_m_s: Vector2
    stop_reason: str = ""
    """Empty in normal operation; otherwise why this command is zero."""
