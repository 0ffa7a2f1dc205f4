"""Keep a distance from every neighbour."""

from collections.abc import Iterable

from edge_runtime.motion.outlook import Neighbour, Outlook
from edge_runtime.objectives.clearance import Clearance


class SafetyMargin(Clearance, frozen=True, kw_only=True, tag="safety_margin"):
    """Keep a distance between centres from every neighbour: J = 1/2 sum (shortfall / position gain)^2."""

    def points(self, outlook: Outlook) -> Iterable[Neighbour]:
        """The neighbours."""
        return outlook.neighbours
