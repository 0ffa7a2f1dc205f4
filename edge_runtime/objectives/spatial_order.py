"""Stand in a given order along x."""

import numpy as np

from edge_runtime.objectives.objective import Objective, Slope, SlopeBatch
from edge_runtime.scene import Floats, Motion, Outlook, OutlookBatch


class SpatialOrder(Objective, frozen=True, kw_only=True, tag="spatial_order"):
    """Stand in ``order`` along x, ``gap_m`` apart: J = 1/2 sum (what is missing / position gain)^2.

    The sum runs over all known neighbours on the wrong side or too near, not over the next in the order
    alone: the same arrangements cost nothing, a lost message leaves the others' pull, and a robot that
    must pass several is drawn the harder. All these costs are slopes of one convex potential, so that the
    robots never hold each other in a wrong order. Robots that ``order`` does not name are free.
    """

    look_ahead: int = 4
    order: tuple[int, ...]
    """Robot ids from left to right."""
    gap_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.order) < 2 or len(set(self.order)) < len(self.order):
            raise ValueError(f"`order` must name at least two robots, each once, got {list(self.order)}")
        if self.gap_m < 0.0:
            raise ValueError(f"`gap_m` must not be negative, got {self.gap_m}")

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
                    cost += 0.5 * cure * cure
                    d_x -= side * cure / gain
        return Slope(cost, d_x)

    def evaluate_batch(self, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch) -> SlopeBatch:
        """Costs and slopes at B predicted motions."""
        gain, order = outlook.preview.position_gain, np.array(self.order)
        own, mate = outlook.robot_id[:, None, None] == order, outlook.mate_id[..., None] == order
        named = own.any(-1) & mate.any(-1)
        side = np.where(own.argmax(-1) > mate.argmax(-1), 1.0, -1.0)
        ahead = side * (position_m[:, :1] - outlook.mate_position_m[..., 0])
        cure = np.where(named, np.maximum(self.gap_m - ahead, 0.0), 0.0) / gain
        slope = np.zeros_like(position_m)
        slope[:, 0] = -(side * cure).sum(-1) / gain
        return SlopeBatch(0.5 * np.square(cure).sum(-1), slope, np.zeros_like(velocity_m_s))
