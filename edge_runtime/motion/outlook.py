"""What objectives see: the team around one robot, and where everybody will be under an action."""

from typing import NamedTuple

import msgspec

from edge_runtime.common.vectors import new_tuple
from edge_runtime.messages import TeamState, TrackedObject, Vector2
from edge_runtime.motion.prediction import Forecast, PredictedMotion, Preview


class Neighbour(NamedTuple):
    """A teammate's predicted motion, its intended action held; see `PredictedMotion`."""

    robot_id: int
    x: float
    y: float
    vx: float
    vy: float
    z: float = 0.0
    vz: float = 0.0
    heading: float = 0.0
    yaw_rate: float = 0.0


class TrackedMotion(NamedTuple):
    """A tracked object's predicted motion, going on as it moves; see `PredictedMotion`."""

    name: str
    x: float
    y: float
    vx: float
    vy: float
    z: float = 0.0
    vz: float = 0.0
    heading: float = 0.0
    yaw_rate: float = 0.0


class Outlook(msgspec.Struct, frozen=True, gc=False):
    """What one tick fixes for one objective: the look-ahead and the neighbours at that time."""

    robot_id: int
    preview: Preview
    """Tells ``position_gain`` and ``velocity_gain``, by which costs are stated."""
    forecast: Forecast
    """The robot's own motion as a function of its action."""
    neighbours: tuple[Neighbour, ...]
    obstacles: tuple[Vector2, ...] = ()
    """Points that the robot's own range sensor sees of what is no teammate, nearest first; they are taken to
    stand still. See `edge_runtime.motion.range_sensor.RangeSensor.obstacles`."""
    tracked: tuple[TrackedMotion, ...] = ()
    """The fleet's tracked objects at that time."""

    @property
    def drift(self) -> PredictedMotion:
        """The robot's own predicted motion under a zero action."""
        return self.forecast.drift


def look_ahead(
    team: TeamState,
    preview: Preview,
    obstacles: tuple[Vector2, ...] = (),
    horizon_s: float = 0.0,
    sees_team: bool = True,
) -> Outlook:
    """Predict one robot's drift and its neighbours' motion over a preview, by the same model.

    Args:
        team: as the robot sees it.
        preview: how robots move until the time of the outlook.
        obstacles: what its range sensor sees.
        horizon_s: how far that time lies ahead, for tracked objects.
        sees_team: False leaves the neighbours out, for whom they are nothing.
    """
    predict, own = preview.predict, team.own
    neighbours = [
        new_tuple(Neighbour, (mate.state.robot_id, *predict(mate.state, mate.intended_action)))
        for mate in (team.teammates + team.silent if sees_team else ())
    ]
    dims = preview.dims
    tracked = tuple([later(each, horizon_s, dims) for each in team.tracked]) if team.tracked else ()
    return Outlook(own.robot_id, preview, preview.forecast(own), tuple(neighbours), obstacles, tracked)


def later(each: TrackedObject, after_s: float, dims: int) -> TrackedMotion:
    """Where it will be; for robots of the plane it has no height."""
    (x, y, *up), (vx, vy, *rise) = each.position_m, each.velocity_m_s
    z, vz = (up[0], rise[0]) if dims == 3 and up and rise else (0.0, 0.0)
    return TrackedMotion(
        each.name,
        x + after_s * vx,
        y + after_s * vy,
        vx,
        vy,
        z + after_s * vz,
        vz,
        each.heading_rad + after_s * each.yaw_rate_rad_s,
        each.yaw_rate_rad_s,
    )
