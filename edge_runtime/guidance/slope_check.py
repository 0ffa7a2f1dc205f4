"""Compares the slopes of a user's own objectives with finite differences, while the robot drives."""

from edge_runtime.guidance.guide import Guide
from edge_runtime.messages import TeamState, Vector
from edge_runtime.objectives import BUILT_IN
from edge_runtime.objectives.gradient_check import compare_slope


class SlopeCheck:
    """Takes one own objective a tick, in turn."""

    def __init__(self) -> None:
        self._turn = 0

    def check(self, guide: Guide, team: TeamState, action: Vector) -> None:
        """Compare at the motion that the tick's action leads to.

        Raises:
            GradientError: names the objective whose slope is wrong, or what it raised.
        """
        own = [place for place, each in enumerate(guide.objectives) if type(each) not in BUILT_IN]
        if not own:
            return
        self._turn += 1
        place = own[self._turn % len(own)]
        outlook = guide.outlook(place, team, guide.sensor.obstacles(team) if guide.sensor else ())
        compare_slope(guide.objectives[place], outlook, action)
