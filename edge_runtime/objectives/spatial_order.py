"""Stand in a given order along x."""

from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope


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
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 4
    order: tuple[int, ...]
    """Robot ids from left to right."""
    gap_m: float
    """Least distance along x between one and the next."""
    pull: float = 0.4
    """Strongest pull on account of one neighbour, in units of the action."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.order) < 2 or len(set(self.order)) < len(self.order):
            raise ValueError(f"`order` must name at least two robots, each once, got {list(self.order)}")
        self.require_not_negative("gap_m")
        self.require_positive("pull")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
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

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.gap_m, self.pull, *map(float, self.order))
