"""Keep clear of whatever the range sensor sees that is not a teammate."""

from collections.abc import Iterable
from typing import ClassVar

from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Neighbour, Outlook
from edge_runtime.objectives.clearance import Clearance, standing


class ObstacleMargin(Clearance, frozen=True, kw_only=True, tag="obstacle_margin"):
    """Keep a distance from obstacles: J = 1/2 sum over what is seen of (shortfall / position gain)^2.

    Obstacles are points on their surfaces, that stand still, see `Outlook.obstacles`; the distance counts
    from there to the robot's centre.
    """

    sees_team: ClassVar[bool] = False

    @property
    def sight_m(self) -> float:
        """How far from its centre the robot must see obstacles."""
        return self.distance_m + self.buffer_m

    def points(self, outlook: Outlook) -> Iterable[Neighbour]:
        """What is seen."""
        return [standing(x, y, 0.0, outlook) for x, y in outlook.obstacles]

    def refuses(self, model: Model) -> str:
        """Why this cannot be asked of a robot that moves so."""
        if model.dims == 3:
            return "its range sensor sees in the plane only"
        return super().refuses(model)
