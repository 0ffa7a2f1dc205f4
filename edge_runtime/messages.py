"""The records that travel through one tick: states in, a command out. SI units, monotonic stamps."""

import msgspec

Vector2 = tuple[float, float]


class RobotState(msgspec.Struct, frozen=True, gc=False):
    """Where one robot is and how it moves, in the team's common frame."""

    robot_id: int
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


class Command(msgspec.Struct, frozen=True, gc=False):
    """One setpoint for the robot's base.

    Bases that take forces or accelerations use ``action``; bases that take velocities use
    ``velocity_m_s``, the velocity which the manifest's dynamics reach at the end of the period.
    """

    robot_id: int
    sequence: int
    stamp_s: float
    action: Vector2
    velocity_m_s: Vector2
    stop_reason: str = ""
    """Empty in normal operation; otherwise why this command is zero."""
