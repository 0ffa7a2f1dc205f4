"""Stay out of a disc, or of a ball."""

from typing import ClassVar

from edge_runtime.messages import Place, Vector
from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.clearance import keep_clear, standing
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class Geofence(Objective, frozen=True, kw_only=True, tag="geofence"):
    """Keep the robot's centre out of a disc: J = 1/2 (depth / position gain)^2.

    In space a centre of two components is that of an upright cylinder, one of three that of a ball.
    """

    sees_team: ClassVar[bool] = False
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 4
    centre_m: Place
    """Of the disc."""
    radius_m: float
    """Of the disc."""
    buffer_m: float = 0.02
    """Guidance starts this far outside the disc."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("radius_m")
        self.require_not_negative("buffer_m")

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        x, y, *height = self.centre_m
        centre = standing(x, y, height[0] if height else motion.z, outlook)
        return keep_clear(motion, (centre,), self.radius_m + self.buffer_m, outlook)

    def refuses(self, model: Model) -> str:
        """Why this cannot be asked of a robot that moves so."""
        if len(self.centre_m) > model.dims:
            return "its centre_m has a height, and the robot moves in the plane"
        return super().refuses(model)

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.radius_m + self.buffer_m, *self.centre_m)
