"""Keep clear of a tracked object: a person, a door, a load."""

from collections.abc import Sequence
from typing import ClassVar

from edge_runtime.motion.outlook import Neighbour, Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.clearance import encode_clear, keep_clear, standing
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class TrackedMargin(Objective, frozen=True, kw_only=True, tag="tracked_margin"):
    """Keep a distance between centres from one tracked object: J = 1/2 (shortfall / position gain)^2.

    It is taken to go on as it moves.
    """

    kernel_term: ClassVar[str] = "safety_margin"
    sees_team: ClassVar[bool] = False
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 3
    object: str
    """Its name in the fleet file."""
    distance_m: float
    """From the robot's centre to the object's."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the margin."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("distance_m")
        self.require_not_negative("buffer_m")

    @property
    def looks_at(self) -> tuple[str, ...]:
        """The object."""
        return (self.object,)

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        return keep_clear(motion, self._points(outlook), self.distance_m + self.buffer_m, outlook)

    def encode(self, outlook: Outlook) -> Sequence[float]:
        """See `encode_clear`: to the kernel the object is a neighbour."""
        return encode_clear(self._points(outlook), self.distance_m + self.buffer_m, outlook)

    def _points(self, outlook: Outlook) -> list[Neighbour]:
        there = (each for each in outlook.tracked if each.name == self.object)
        return [standing(each.x, each.y, each.z, outlook) for each in there]
