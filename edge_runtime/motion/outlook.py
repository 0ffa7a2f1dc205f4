"""What objectives see: the team around one robot, and where everybody will be under an action."""

from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from edge_runtime.messages import TeamState
from edge_runtime.motion.dynamics import Preview

Floats = npt.NDArray[np.float64]


class Motion(NamedTuple):
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
    drift: Motion
    """The robot's own predicted motion under a zero action."""
    neighbours: tuple[Neighbour, ...]


def look_ahead(team: TeamState, preview: Preview) -> Outlook:
    """Predict one robot's drift and its neighbours' motion over a preview."""
    (x, y), (vx, vy) = team.own.position_m, team.own.velocity_m_s
    reach, keep = preview.position_decay, preview.velocity_decay
    drift = Motion(x + reach * vx, y + reach * vy, keep * vx, keep * vy)
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
    return Outlook(team.own.robot_id, preview, drift, tuple(neighbours))


@dataclass(frozen=True)
class TeamBatch:
    """B robots' views of their teams as arrays: the batched `TeamState`, for evaluation."""

    robot_id: npt.NDArray[np.int64]
    """(B,)"""
    position_m: Floats
    """(B, 2)"""
    velocity_m_s: Floats
    """(B, 2)"""
    mate_id: npt.NDArray[np.int64]
    """(B, K)"""
    mate_position_m: Floats
    """(B, K, 2)"""
    mate_velocity_m_s: Floats
    """(B, K, 2)"""
    mate_action: Floats
    """(B, K, 2), the teammates' intended actions."""


@dataclass(frozen=True)
class OutlookBatch:
    """The batched `Outlook`."""

    robot_id: npt.NDArray[np.int64]
    preview: Preview
    drift_position_m: Floats
    """(B, 2)"""
    drift_velocity_m_s: Floats
    """(B, 2)"""
    mate_id: npt.NDArray[np.int64]
    """(B, K)"""
    mate_position_m: Floats
    """(B, K, 2)"""
    mate_velocity_m_s: Floats
    """(B, K, 2)"""

    def row(self, index: int) -> Outlook:
        """The single-robot outlook of one row."""
        mates = zip(
            self.mate_id[index].tolist(),
            self.mate_position_m[index].tolist(),
            self.mate_velocity_m_s[index].tolist(),
            strict=True,
        )
        drift = Motion(*self.drift_position_m[index].tolist(), *self.drift_velocity_m_s[index].tolist())
        neighbours = tuple(Neighbour(mate, *position, *velocity) for mate, position, velocity in mates)
        return Outlook(int(self.robot_id[index]), self.preview, drift, neighbours)


def look_ahead_batch(team: TeamBatch, preview: Preview) -> OutlookBatch:
    """Predict B robots' drifts and their neighbours' motion over a preview."""
    reach, keep = preview.position_decay, preview.velocity_decay
    return OutlookBatch(
        team.robot_id,
        preview,
        team.position_m + reach * team.velocity_m_s,
        keep * team.velocity_m_s,
        team.mate_id,
        team.mate_position_m + reach * team.mate_velocity_m_s + preview.position_gain * team.mate_action,
        keep * team.mate_velocity_m_s + preview.velocity_gain * team.mate_action,
    )
