"""What each robot of E simulated teams knows of its teammates: the nearest K, as they were last heard."""

import numpy as np
import numpy.typing as npt

from benchmarks.paper.rows import Setting
from edge_runtime.common.arrays import Floats
from export.evaluation.outlook import TeamBatch


class Neighbourhood:
    """Turns the states of E teams of N robots into E N robots' views.

    Args:
        episodes: E.
        robots: N.
        setting: how many are heard, and what of their messages; a teammate whose message is lost stays as
            last received.
        draw: which messages are lost.
    """

    def __init__(self, episodes: int, robots: int, setting: Setting, draw: np.random.Generator) -> None:
        mates = [[mate for mate in range(robots) if mate != own] for own in range(robots)]
        self._mates = np.array(mates, np.int64).reshape(robots, robots - 1)
        self._own = np.tile(np.arange(robots), episodes)
        self._ids = np.tile(self._mates, (episodes, 1))
        self._setting, self._draw = setting, draw
        self._heard: Floats | None = None

    def views(self, position: Floats, velocity: Floats, action: Floats) -> TeamBatch:
        """Arrange positions, velocities and last commanded actions, each (E, N, 2)."""
        rows = len(self._own)
        action = action if self._setting.intentions else np.zeros_like(action)
        own = np.concatenate([position, velocity], -1).reshape(rows, 4)
        heard = self._hear(np.concatenate([position, velocity, action], -1)[:, self._mates])
        nearest = self._nearest(own[:, :2], heard[..., :2])
        heard = np.take_along_axis(heard, nearest[..., None], 1)
        return TeamBatch(
            robot_id=self._own,
            position_m=own[:, :2],
            velocity_m_s=own[:, 2:],
            mate_id=np.take_along_axis(self._ids, nearest, 1),
            mate_position_m=heard[..., :2],
            mate_velocity_m_s=heard[..., 2:4],
            mate_action=heard[..., 4:],
        )

    def _hear(self, sent: Floats) -> Floats:
        """Teammates' (E, N, N - 1, 6) as received, (E N, N - 1, 6); the first messages all arrive."""
        sent = sent.reshape(len(self._own), *sent.shape[2:])
        if self._heard is None or not self._setting.loss:
            self._heard = sent
        else:
            lost = self._draw.random(sent.shape[:2]) < self._setting.loss
            self._heard = np.where(lost[..., None], self._heard, sent)
        return self._heard

    def _nearest(self, own: Floats, mates: Floats) -> npt.NDArray[np.int64]:
        distance = np.linalg.norm(mates - own[:, None], axis=-1)
        return np.argsort(distance, axis=1, kind="stable")[:, : self._setting.neighbours]
