"""Draw the team to a tracked object: a load to fetch, a person to go with, the place of a belief."""

import math
from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives.objective import Objective, Quantity, Slope


class Attraction(Objective, frozen=True, kw_only=True, tag="attraction"):
    """Have the middle of the n robots in sight, oneself included, at it: J = n h(distance / position gain).

    h(c) is c^2 / 2 up to ``pull``, and goes on as a straight line. All robots are pulled alike, as the middle
    is, so that the team goes there as it stands, and no formation is stretched. Where nobody tells of the
    object, it costs nothing.
    """

    preference: ClassVar[bool] = True
    of: ClassVar[Quantity] = "position"
    look_ahead: int = 4
    object: str
    """Its name in the fleet file."""
    pull: float = 0.2
    """How strongly at most, in units of the action: for each step of the preferences' correction."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("pull")

    @property
    def looks_at(self) -> tuple[str, ...]:
        """The object."""
        return (self.object,)

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        mates, gain = outlook.neighbours, outlook.preview.position_gain
        count = len(mates) + 1
        for each in outlook.tracked:
            if each.name == self.object:
                dx = (motion.x + sum(mate.x for mate in mates)) / count - each.x
                dy = (motion.y + sum(mate.y for mate in mates)) / count - each.y
                dz = (motion.z + sum(mate.z for mate in mates)) / count - each.z
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                cure = distance / gain
                pull = min(cure, self.pull)
                push = pull / (gain * (distance or 1.0))
                cost = count * pull * (cure - 0.5 * pull)
                return Slope(cost, push * dx, push * dy, 0.0, 0.0, push * dz)
        return Slope(0.0)

    def kernel_numbers(self) -> Vector:
        """See `Objective.kernel_numbers`."""
        return (self.pull,)
