"""What each robot of E simulated teams knows of its teammates: the nearest K, as they were last heard."""

from dataclasses import replace

import msgspec
import numpy as np

from edge_runtime.common.arrays import Floats
from export.evaluation.outlook import MotionBatch, TeamBatch


class Setting(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, forbid_unknown_fields=True):
    """Which episodes, and what the robots hear of each other."""

    episodes: int
    episodes_seed: int
    """Of starts, goals, noise and lost messages."""
    neighbours: int | None = None
    """K, the nearest at every step; None for all."""
    loss: float = 0.0
    """Share of the messages lost."""
    intentions: bool = True
    """Whether messages tell intended actions; else teammates take them for zero."""


class Neighbourhood:
    """Turns the states of E teams of N robots into E N robots' views.

    Args:
        setting: how many are heard, and what of their messages; a teammate whose message is lost stays as
            last received.
        draw: which messages are lost.
    """

    def __init__(self, setting: Setting, draw: np.random.Generator) -> None:
        self._setting, self._draw = setting, draw
        self._heard: Floats | None = None

    def views(self, position: Floats, velocity: Floats, action: Floats) -> TeamBatch:
        """Arrange positions, velocities and last commanded actions, each (E, N, 2)."""
        told = action if self._setting.intentions else np.zeros_like(action)
        sent = TeamBatch.of_teams(position, velocity, told)
        heard = self._hear(
            np.concatenate([sent.mates.position_m, sent.mates.velocity_m_s, sent.mate_action], -1)
        )
        distance = np.linalg.norm(heard[..., :2] - sent.own.position_m[:, None], axis=-1)
        nearest = np.argsort(distance, axis=1, kind="stable")[:, : self._setting.neighbours]
        heard = np.take_along_axis(heard, nearest[..., None], 1)
        return replace(
            sent,
            mate_id=np.take_along_axis(sent.mate_id, nearest, 1),
            mates=MotionBatch.of(heard[..., :2], heard[..., 2:4]),
            mate_action=heard[..., 4:],
        )

    def _hear(self, sent: Floats) -> Floats:
        """Teammates' (E N, N - 1, 6) as received; the first messages all arrive."""
        if self._heard is None or not self._setting.loss:
            self._heard = sent
        else:
            lost = self._draw.random(sent.shape[:2]) < self._setting.loss
            self._heard = np.where(lost[..., None], self._heard, sent)
        return self._heard
