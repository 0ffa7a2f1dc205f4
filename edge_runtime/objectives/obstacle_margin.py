"""Keep clear of whatever the range sensor sees that is not a teammate."""

from collections.abc import Sequence
from typing import ClassVar

from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Neighbour, Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.clearance import encode_clear, keep_clear, standing
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class ObstacleMargin(Objective, frozen=True, kw_only=True, tag="obstacle_margin"):
    """Keep a distance from obstacles: J = 1/2 sum over what is seen of (shortfall / position gain)^2.

    Obstacles are points on their surfaces, that stand still, see `Outlook.obstacles`; the distance counts
    from there to the robot's centre.
    """

    kernel_term: ClassVar[str] = "safety_margin"
    sees_team: ClassVar[bool] = False
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 3
    distance_m: float
    """From the robot's centre to the surface that is seen."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")
        self.require_not_negative("buffer_m")

    @property
    def sight_m(self) -> float:
        """How far from its centre the robot must see obstacles."""
        return self.distance_m + self.buffer_m

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        return keep_clear(motion, self._points(outlook), self.distance_m + self.buffer_m, outlook)

    def encode(self, outlook: Outlook) -> Sequence[float]:
        """See `encode_clear`: to the kernel obstacles are neighbours."""
        return encode_clear(self._points(outlook), self.distance_m + self.buffer_m, outlook)

    def refuses(self, model: Model) -> str:
        """Why this cannot be asked of a robot that moves so."""
        if model.dims == 3:
            return "its range sensor sees in the plane only"
        return super().refuses(model)

    def _points(self, outlook: Outlook) -> list[Neighbour]:
        return [standing(x, y, 0.0, outlook) for x, y in outlook.obstacles]
