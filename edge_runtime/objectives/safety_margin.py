"""Keep a distance from every neighbour."""

from collections.abc import Sequence
from typing import ClassVar

from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.clearance import encode_clear, keep_clear
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class SafetyMargin(Objective, frozen=True, kw_only=True, tag="safety_margin"):
    """Keep a distance between centres from every neighbour: J = 1/2 sum (shortfall / position gain)^2."""

    kernel_term: ClassVar[str] = "safety_margin"
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 3
    distance_m: float
    """Between the centres of two robots."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")
        self.require_not_negative("buffer_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        return keep_clear(motion, outlook.neighbours, self.distance_m + self.buffer_m, outlook)

    def encode(self, outlook: Outlook) -> Sequence[float]:
        """See `encode_clear`."""
        return encode_clear(outlook.neighbours, self.distance_m + self.buffer_m, outlook)
