"""What objectives see: the team around one robot, and where everybody will be under an action."""

from typing import NamedTuple

import msgspec

from edge_runtime.messages import TeamState, Vector2
from edge_runtime.motion.dynamics import Preview


class PredictedMotion(NamedTuple):
    """Predicted planar motion of one robot, in m and m/s."""

    x: float
    y: float
    vx: float
    vy: float


class Neighbour(NamedTuple):
    """A teammate's predicted motion, its intended action held."""

    robot_id: int
    x: float
    y: float
    vx: float
    vy: float


class Outlook(msgspec.Struct, frozen=True, gc=False):
    """What one tick fixes for one objective: the look-ahead's gains and the neighbours at that time."""

    robot_id: int
    preview: Preview
    drift: PredictedMotion
    """The robot's own predicted motion under a zero action."""
    neighbours: tuple[Neighbour, ...]
    obstacles: tuple[Vector2, ...] = ()
    """Points that the robot's own range sensor sees of what is no teammate, nearest first; they are taken to
    stand still. See `edge_runtime.motion.range_sensor.RangeSensor.obstacles`."""


def look_ahead(team: TeamState, preview: Preview, obstacles: tuple[Vector2, ...] = ()) -> Outlook:
    """Predict one robot's drift and its neighbours' motion over a preview."""
    (x, y), (vx, vy) = team.own.position_m, team.own.velocity_m_s
    reach, keep = preview.position_decay, preview.velocity_decay
    drift = PredictedMotion(x + reach * vx, y + reach * vy, keep * vx, keep * vy)
    neighbours = []
    for mate in team.teammates + team.silent:
        state = mate.state
        (x, y), (vx, vy), (ux, uy) = state.position_m, state.velocity_m_s, mate.intended_action
        shift, push = preview.position_gain, preview.velocity_gain
        neighbours.append(
            Neighbour(
                state.robot_id,
                x + reach * vx + shift * ux,
                y + reach * vy + shift * uy,
                keep * vx + push * ux,
                keep * vy + push * uy,
            )
        )
    return Outlook(team.own.robot_id, preview, drift, tuple(neighbours), obstacles)
