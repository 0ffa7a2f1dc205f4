"""Keep clear of a tracked object: a person, a door, a load."""

from collections.abc import Iterable
from typing import ClassVar

from edge_runtime.motion.outlook import Neighbour, Outlook
from edge_runtime.objectives.clearance import Clearance, standing


class TrackedMargin(Clearance, frozen=True, kw_only=True, tag="tracked_margin"):
    """Keep a distance between centres from one tracked object: J = 1/2 (shortfall / position gain)^2.

    It is taken to go on as it moves.
    """

    sees_team: ClassVar[bool] = False
    object: str
    """Its name in the fleet file."""

    @property
    def looks_at(self) -> tuple[str, ...]:
        """The object."""
        return (self.object,)

    def points(self, outlook: Outlook) -> Iterable[Neighbour]:
        """Where the object will be."""
        there = (each for each in outlook.tracked if each.name == self.object)
        return [standing(each.x, each.y, each.z, outlook) for each in there]
