"""What B robots know of their teams, and where everybody will be: `edge_runtime.motion.outlook` in arrays."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.motion.dynamics import Preview
from edge_runtime.motion.outlook import Neighbour, Outlook, PredictedMotion


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

    @classmethod
    def of_teams(cls, position_m: Floats, velocity_m_s: Floats, action: Floats) -> "TeamBatch":
        """Return the views of all robots of E teams of N, (E, N, 2) each: B = E N, K = N - 1."""
        teams, robots, _ = position_m.shape
        others = [[mate for mate in range(robots) if mate != own] for own in range(robots)]
        mates = np.array(others, np.int64).reshape(robots, robots - 1)
        shape = (teams * robots, robots - 1, 2)
        seen = (values[:, mates].reshape(shape) for values in (position_m, velocity_m_s, action))
        own = np.tile(np.arange(robots), teams)
        return cls(
            own, position_m.reshape(-1, 2), velocity_m_s.reshape(-1, 2), np.tile(mates, (teams, 1)), *seen
        )


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
        drift = PredictedMotion(
            *self.drift_position_m[index].tolist(), *self.drift_velocity_m_s[index].tolist()
        )
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
