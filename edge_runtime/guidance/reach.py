"""How far preferences may move the finished action now: more where what the team carries is at its goal."""

import math
from collections.abc import Iterable

from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.messages import TrackedObject, Vector


def reach_now(guidance: GuidanceSettings, tracked: Iterable[TrackedObject]) -> float:
    """The reach in this tick, in units of the action.

    Args:
        guidance: what was asked for.
        tracked: the tracked objects that the robot knows of; those that have a goal count.
    """
    if guidance.goal_reach is None:
        return guidance.reach
    left_m = [_apart(each.position_m, each.goal_m) for each in tracked if each.goal_m is not None]
    arrived = bool(left_m) and max(left_m) <= guidance.goal_within_m
    return guidance.goal_reach if arrived else guidance.reach


def _apart(place: Vector, goal: Vector) -> float:
    """Distance of two places in the components that both have: a planar goal is at any height."""
    return math.hypot(*(a - b for a, b in zip(place, goal, strict=False)))
