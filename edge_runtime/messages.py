"""The records that travel through one tick, from states to a command. SI units, monotonic stamps."""

from typing import Annotated, Final

import msgspec

Vector2 = tuple[float, float]
"""What lies in the plane, whatever the robot."""
Vector = tuple[float, ...]
Place = Annotated[Vector, msgspec.Meta(min_length=2, max_length=3)]
"""A position or velocity of two components in the plane, or three in space."""
LONGEST_ACTION: Final = 8
Action = Annotated[Vector, msgspec.Meta(min_length=1, max_length=LONGEST_ACTION)]
"""An action, or a change of one: d components, in the policy's units."""
Integer = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""A whole number as other programs and machines hold it, in 64 bits."""


class RobotState(msgspec.Struct, frozen=True, gc=False):
    """Where one robot is and how it moves, in the team's common frame."""

    robot_id: Integer
    stamp_s: float
    """Monotonic time of the measurement."""
    position_m: Place
    velocity_m_s: Place
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0


class Teammate(msgspec.Struct, frozen=True, gc=False):
    """What a robot knows of a neighbour: its state, what it intends, and how old that is."""

    state: RobotState
    intended_action: Action = (0.0, 0.0)
    """The action that the neighbour commanded last, in the policy's action units."""
    age_s: float = 0.0


class TrackedObject(msgspec.Struct, frozen=True, gc=False):
    """What is no robot, yet has a pose stream: a payload, a person, a door; in the team's common frame."""

    name: str
    """As the fleet file calls it."""
    stamp_s: float
    """Monotonic time of the measurement."""
    position_m: Place
    velocity_m_s: Place
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
    age_s: float = 0.0
    goal_m: Place | None = None
    """Where it is to go, as the fleet file says; None where it says nothing."""


class Reading(msgspec.Struct, frozen=True, gc=False):
    """What a sensor of the robot's, told by its name, read in this tick."""

    sensor: str
    """Its name."""
    values: Vector
    """As many as it has."""


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
    tracked: tuple[TrackedObject, ...] = ()
    """The fleet file's tracked objects, in its order."""
    readings: tuple[Reading, ...] = ()
    """Of sensors other than the range sensor."""


class GuidedAction(msgspec.Struct, frozen=True, gc=False):
    """One sampled action and what happened on the way; see `edge_runtime.guidance.flow`."""

    action: Action
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
    correction: Action = (0.0, 0.0)
    """How far the finished action was moved at tau = 1; mode ``terminal`` only."""
    cut: bool = False
    """Whether the deadline came before the last step."""
    objective_failed: bool = False
    """Whether the fault is an objective's: it raised, or has no finite gradient."""


class Command(msgspec.Struct, frozen=True, gc=False):
    """One setpoint for the robot's base.

    Bases that take forces or accelerations use ``action``; bases that take velocities use
    ``velocity_m_s`` and, where they can turn on their own, ``yaw_rate_rad_s``: the velocity and the yaw rate
    which the manifest's motion model reaches at the end of the period.
    """

    robot_id: Integer
    sequence: Integer
    stamp_s: float
    action: Action
    velocity_m_s: Place
    yaw_rate_rad_s: float = 0.0
    stop_reason: str = ""
    """Empty in normal operation; otherwise why this command is zero."""
