"""Stand in a given order along x."""

from typing import ClassVar

import numpy as np

from edge_runtime.motion.outlook import Floats, Motion, Outlook, OutlookBatch
from edge_runtime.objectives.objective import Objective, Slope, SlopeBatch


class SpatialOrder(Objective, frozen=True, kw_only=True, tag="spatial_order"):
    """Stand in ``order`` along x, ``gap_m`` apart: J = sum h(what is missing / position gain).

    h(c) is c^2 / 2 up to ``pull``, and goes on as a straight line: robots that must change places do so
    in seconds, at a moderate pull, and keep carrying meanwhile.

    The sum runs over all known neighbours on the wrong side or too near, not over the next in the order
    alone: the same arrangements cost nothing, a lost message leaves the others' pull, and a robot that
    must pass several is drawn the harder. All these costs are slopes of one convex potential, so that the
    robots never hold each other in a wrong order. Robots that ``order`` does not name are free.
    """

    preference: ClassVar[bool] = True
    look_ahead: int = 4
    order: tuple[int, ...]
    """Robot ids from left to right."""
    gap_m: float
    pull: float = 0.4
    """Strongest pull on account of one neighbour, in units of the action."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.order) < 2 or len(set(self.order)) < len(self.order):
            raise ValueError(f"`order` must name at least two robots, each once, got {list(self.order)}")
        if self.gap_m < 0.0 or self.pull <= 0.0:
            raise ValueError(
                f"`gap_m` must not be negative and `pull` must be positive, got {self.gap_m} and {self.pull}"
            )

    def evaluate(self, motion: Motion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        cost = d_x = 0.0
        if outlook.robot_id not in self.order:
            return Slope(cost)
        gain, own = outlook.preview.position_gain, self.order.index(outlook.robot_id)
        for mate in outlook.neighbours:
            if mate.robot_id in self.order:
                side = 1.0 if own > self.order.index(mate.robot_id) else -1.0
                cure = (self.gap_m - side * (motion.x - mate.x)) / gain
                if cure > 0.0:
                    pull = min(cure, self.pull)
                    cost += pull * (cure - 0.5 * pull)
                    d_x -= side * pull / gain
        return Slope(cost, d_x)

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions."""
        gain, order = outlook.preview.position_gain, np.array(self.order)
        own, mate = outlook.robot_id[:, None, None] == order, outlook.mate_id[..., None] == order
        named = own.any(-1) & mate.any(-1)
        side = np.where(own.argmax(-1) > mate.argmax(-1), 1.0, -1.0)
        ahead = side * (position_m[:, :1] - outlook.mate_position_m[..., 0])
        cure = np.where(named, np.maximum(self.gap_m - ahead, 0.0), 0.0) / gain
        pull = np.minimum(cure, self.pull)
        slope = np.zeros_like(position_m)
        slope[:, 0] = -(side * pull).sum(-1) / gain
        return SlopeBatch((pull * (cure - 0.5 * pull)).sum(-1), slope, np.zeros_like(velocity_m_s))
