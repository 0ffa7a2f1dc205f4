"""What B robots know of their teams, and where everybody will be: `edge_runtime.motion.outlook` in arrays."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.messages import RobotState, Teammate, TeamState, TrackedObject, Vector
from edge_runtime.motion.linear import LinearPreview, PlanarPreview
from edge_runtime.motion.outlook import Outlook, look_ahead
from edge_runtime.motion.prediction import PredictedMotion, Preview
from edge_runtime.motion.unicycle import Rolling, UnicyclePreview

COMPONENTS = len(PredictedMotion._fields)
"""C, of a `PredictedMotion`."""
POSITION, VELOCITY = [0, 1, 4], [2, 3, 5]
"""Where those of position and velocity stand."""


Rows = npt.NDArray[np.intp]
"""Which of B robots, by their places."""


class MotionBatch(NamedTuple):
    """Motions of robots, any leading axes: the batched `PredictedMotion`."""

    position_m: Floats
    """(..., dims)"""
    velocity_m_s: Floats
    """(..., dims)"""
    heading_rad: Floats
    """(...)"""
    yaw_rate_rad_s: Floats
    """(...)"""

    @classmethod
    def of(cls, position_m: Floats, velocity_m_s: Floats) -> "MotionBatch":
        """Motions of robots that do not turn."""
        nothing = np.zeros(position_m.shape[:-1])
        return cls(position_m, velocity_m_s, nothing, nothing)

    def take(self, index: int | tuple[int, ...] | Rows) -> "MotionBatch":
        """The motions at an index of the leading axes."""
        return MotionBatch(*(values[index] for values in self))

    def state(self, robot_id: int) -> RobotState:
        """The state of one robot, if this is one motion."""
        return RobotState(robot_id, 0.0, *self._numbers())

    def tracked(self, name: str) -> TrackedObject:
        """One tracked object, if this is one motion."""
        return TrackedObject(name, 0.0, *self._numbers())

    def _numbers(self) -> tuple[Vector, Vector, float, float]:
        position, velocity = tuple(self.position_m.tolist()), tuple(self.velocity_m_s.tolist())
        return position, velocity, float(self.heading_rad), float(self.yaw_rate_rad_s)


@dataclass(frozen=True)
class TeamBatch:
    """B robots' views of their teams as arrays: the batched `TeamState`, for evaluation."""

    robot_id: npt.NDArray[np.int64]
    """(B,)"""
    own: MotionBatch
    """Of B robots."""
    mate_id: npt.NDArray[np.int64]
    """(B, K)"""
    mates: MotionBatch
    """Of (B, K) teammates."""
    mate_action: Floats
    """(B, K, d), the teammates' intended actions."""
    tracked: Mapping[str, MotionBatch] = field(default_factory=dict)
    """The tracked objects by their names, each as B robots see it."""
    left_m: Floats | None = None
    """How far the tracked objects that have a goal are from it, (B,), the greatest distance; None without."""

    @classmethod
    def of_teams(cls, position_m: Floats, velocity_m_s: Floats, action: Floats) -> "TeamBatch":
        """Return the views of all robots of E teams of N that do not turn, (E, N, ...) each: B = E N."""
        motion = MotionBatch.of(position_m, velocity_m_s)
        teams, robots = action.shape[:2]
        others = [[mate for mate in range(robots) if mate != own] for own in range(robots)]
        mates = np.array(others, np.int64).reshape(robots, robots - 1)

        def seen(values: Floats) -> Floats:
            return values[:, mates].reshape(teams * robots, robots - 1, *values.shape[2:])

        own = MotionBatch(*(values.reshape(teams * robots, *values.shape[2:]) for values in motion))
        ids = np.tile(np.arange(robots), teams)
        around = MotionBatch(*map(seen, motion))
        return cls(ids, own, np.tile(mates, (teams, 1)), around, seen(action))

    def take(self, rows: Rows) -> "TeamBatch":
        """The views of some of the robots."""
        return TeamBatch(
            self.robot_id[rows],
            self.own.take(rows),
            self.mate_id[rows],
            self.mates.take(rows),
            self.mate_action[rows],
            {name: motion.take(rows) for name, motion in self.tracked.items()},
            None if self.left_m is None else self.left_m[rows],
        )

    def row(self, index: int) -> TeamState:
        """One robot's view."""
        mates = tuple(
            Teammate(self.mates.take((index, k)).state(mate), tuple(self.mate_action[index, k].tolist()))
            for k, mate in enumerate(self.mate_id[index].tolist())
        )
        tracked = tuple(motion.take(index).tracked(name) for name, motion in self.tracked.items())
        return TeamState(self.own.take(index).state(int(self.robot_id[index])), mates, tracked=tracked)


@dataclass(frozen=True)
class OutlookBatch:
    """The batched `Outlook`."""

    team: TeamBatch
    preview: Preview
    drift: MotionBatch
    """Of B robots."""
    mates: MotionBatch
    """Of (B, K) teammates."""
    at: Callable[[Floats], tuple[MotionBatch, Floats]]
    """Motions under actions (B, d), and their Jacobians (B or 1, d, C): see `Columns`."""
    horizon_s: float = 0.0
    """How far ahead they are, for tracked objects."""

    @property
    def robot_id(self) -> npt.NDArray[np.int64]:
        """Whose they are, (B,)."""
        return self.team.robot_id

    @property
    def mate_id(self) -> npt.NDArray[np.int64]:
        """Who the teammates are, (B, K)."""
        return self.team.mate_id

    def row(self, index: int) -> Outlook:
        """The single-robot outlook of one row."""
        return look_ahead(self.team.row(index), self.preview, horizon_s=self.horizon_s)

    def tracked_m(self, name: str) -> Floats:
        """Where a tracked object will be, (B, 1, dims); (B, 0, dims) where nobody tracks it."""
        dims, motion = self.preview.dims, self.team.tracked.get(name)
        if motion is None:
            return np.zeros((len(self.robot_id), 0, dims))
        there: Floats = motion.position_m + self.horizon_s * motion.velocity_m_s
        return there[:, None, :dims]


def look_ahead_batch(team: TeamBatch, preview: Preview, horizon_s: float = 0.0) -> OutlookBatch:
    """Predict B robots' drifts and their neighbours' motion over a preview; see `look_ahead`."""
    own = _forecast(preview, team.own)
    mates, _ = _forecast(preview, team.mates)(team.mate_action)
    drift, _ = own(np.zeros((len(team.robot_id), team.mate_action.shape[-1])))
    return OutlookBatch(team, preview, drift, mates, own, horizon_s)


def _forecast(preview: Preview, start: MotionBatch) -> Callable[[Floats], tuple[MotionBatch, Floats]]:
    """The batched `Preview.forecast`: motions and Jacobians as functions of actions (..., d)."""
    if not isinstance(preview, LinearPreview | PlanarPreview):
        return functools.partial(_rolled, preview, start)
    columns = np.array([[*column, *[0.0] * (COMPONENTS - len(column))] for column in preview.columns])
    drift = _drift(preview, start)

    def at(action: Floats) -> tuple[MotionBatch, Floats]:
        moved = action @ columns
        place, speed = POSITION[: preview.dims], VELOCITY[: preview.dims]
        return (
            MotionBatch(
                drift.position_m + moved[..., place],
                drift.velocity_m_s + moved[..., speed],
                drift.heading_rad + moved[..., 6],
                drift.yaw_rate_rad_s + moved[..., 7],
            ),
            columns[None],
        )

    return at


def _drift(preview: LinearPreview | PlanarPreview, start: MotionBatch) -> MotionBatch:
    if isinstance(preview, PlanarPreview):
        nothing = np.zeros_like(start.heading_rad)
        return MotionBatch(
            start.position_m + preview.position_decay * start.velocity_m_s,
            preview.velocity_decay * start.velocity_m_s,
            nothing,
            nothing,
        )
    places, turn = preview.axes[: preview.dims], preview.axes[preview.dims :]
    reach, keep = (np.array([getattr(axis, name) for axis in places]) for name in _DECAYS)
    heading, yaw_rate = np.zeros_like(start.heading_rad), np.zeros_like(start.heading_rad)
    for axis in turn:
        heading = start.heading_rad + axis.position_decay * start.yaw_rate_rad_s
        yaw_rate = axis.velocity_decay * start.yaw_rate_rad_s
    return MotionBatch(
        start.position_m + reach * start.velocity_m_s, keep * start.velocity_m_s, heading, yaw_rate
    )


_DECAYS = ("position_decay", "velocity_decay")


def _rolled(preview: Preview, start: MotionBatch, action: Floats) -> tuple[MotionBatch, Floats]:
    if not isinstance(preview, UnicyclePreview):
        raise TypeError(f"{type(preview).__name__} has no batched form")
    heading, (vx, vy) = start.heading_rad, np.moveaxis(start.velocity_m_s, -1, 0)
    speed = vx * np.cos(heading) + vy * np.sin(heading)
    rolling = Rolling(*np.moveaxis(start.position_m, -1, 0), heading, speed, start.yaw_rate_rad_s)
    moved, columns = preview.model.roll(rolling, np.moveaxis(action, -1, 0), preview.steps, np.cos, np.sin)
    motion = MotionBatch(
        np.stack([moved.x, moved.y], -1), np.stack([moved.vx, moved.vy], -1), moved.heading, moved.yaw_rate
    )
    nothing = np.zeros_like(speed)
    rows = [[*column, *[nothing] * (COMPONENTS - len(column))] for column in columns]
    return motion, np.stack([np.stack(np.broadcast_arrays(*row), -1) for row in rows], -2)
