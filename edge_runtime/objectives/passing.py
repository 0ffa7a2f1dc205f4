"""Pass one another on agreed sides."""

from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class Passing(Objective, frozen=True, kw_only=True, tag="passing"):
    """Let robots on their way to an ``order`` along x pass: J = sum h(clearance that is missing / gain).

    Two robots that must change places along x push against each other for good if both want nothing but
    that: `SpatialOrder` has no slope along y. Here the one that stands later in the order, of each pair that
    is still on the wrong sides and within ``reach_m``, goes below the other (smaller y) by ``clearance_m``;
    the other need do nothing. Both know the order, so they agree without a word. h is that of `SpatialOrder`.

    Which pairs these are is decided by where the robot drifts under a zero action, so that the cost is smooth
    in the action. It is a requirement, not a preference: getting out of the way is not to be limited. Robots
    that ``order`` does not name are free.

    Raises:
        ValueError: if the order names a robot twice or fewer than two, the margin is negative, or another
            length or the pull is not positive.
    """

    of: ClassVar[Quantity] = "position"
    look_ahead: int = 4
    order: tuple[int, ...]
    """Robot ids from left to right."""
    reach_m: float = 0.12
    """Distance within which two robots are about to pass."""
    margin_m: float = 0.0
    """How far beyond each other two robots must be along x to have passed."""
    clearance_m: float = 0.07
    """Between the centres, while they pass."""
    pull: float = 2.0
    """Strongest pull on account of one neighbour, in units of the action."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.order) < 2 or len(set(self.order)) < len(self.order):
            raise ValueError(f"`order` must name at least two robots, each once, got {list(self.order)}")
        self.require_positive("reach_m", "clearance_m", "pull")
        self.require_not_negative("margin_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        cost = d_y = 0.0
        if outlook.robot_id not in self.order:
            return Slope(cost)
        gain, drift = outlook.preview.position_gain, outlook.drift
        own = self.order.index(outlook.robot_id)
        for mate in outlook.neighbours:
            dx, dy = drift.x - mate.x, drift.y - mate.y
            if dx >= self.margin_m or dx * dx + dy * dy >= self.reach_m * self.reach_m:
                continue
            if mate.robot_id not in self.order or self.order.index(mate.robot_id) > own:
                continue
            cure = (self.clearance_m + motion.y - mate.y) / gain
            if cure > 0.0:
                pull = min(cure, self.pull)
                cost += pull * (cure - 0.5 * pull)
                d_y += pull / gain
        return Slope(cost, 0.0, d_y)

    def refuses(self, model: Model) -> str:
        """Why this cannot be asked of a robot that moves so."""
        if model.dims == 3:
            return "robots in space pass above and below one another, it parts them along y"
        return super().refuses(model)

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.clearance_m, self.pull, self.margin_m, self.reach_m, *map(float, self.order))
