"""What a robot makes of its past: where something lies that nobody tells it of, as what it searches for."""

import math
from collections.abc import Mapping

from msgspec.structs import replace

from edge_runtime.common.own_code import cause_of
from edge_runtime.common.signals import is_interrupt
from edge_runtime.messages import TeamState, TrackedObject, Vector


class Belief:
    """Of one robot, from its first tick to its last: the base of those of one's own.

    The fleet file names the class, and what its ``__init__`` is given.
    """

    def follow(self, team: TeamState) -> Vector | None:
        """Take one tick in.

        Returns:
            The place believed in, of as many components as the robot's own; None while there is none.
        """
        raise NotImplementedError(f"{type(self).__name__} must define follow(team)")


class Beliefs:
    """Adds what one robot believes to what it tracks: objectives know both by their names.

    Args:
        each: by name.
    """

    def __init__(self, each: Mapping[str, Belief]) -> None:
        self._each = each

    def added(self, team: TeamState) -> TeamState:
        """Take one tick in; with a fault if a belief raises, or tells no place."""
        if not self._each:
            return team
        tracked = list(team.tracked)
        for name, belief in self._each.items():
            try:
                place = belief.follow(team)
                if place is not None:
                    tracked.append(_placed(name, tuple(map(float, place)), team))
            except BaseException as error:  # it may raise anything
                if is_interrupt(error):
                    raise
                return replace(team, fault=team.fault or f"belief {name}: it raised {cause_of(error)}")
        return replace(team, tracked=tuple(tracked))


def _placed(name: str, place: Vector, team: TeamState) -> TrackedObject:
    own = team.own
    if len(place) != len(own.position_m) or not math.isfinite(sum(place)):
        raise ValueError(f"{place} is no place of {len(own.position_m)} components")
    return TrackedObject(name, own.stamp_s, place, (0.0,) * len(place))
