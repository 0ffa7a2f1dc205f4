"""The finished action moved at tau = 1, for one robot: as preferences wish, then as is required.

    a <- argmin sum_m lambda_m J_m over the ball of radius ``reach`` around a, approximately,   preferences
    a <- a + cone(1, -grad J(a)), and on while any is violated: a <- a + x, see `_step`         requirements

in Newton steps for costs in squared action units, whatever eta and however contracted the flow.
Preferences (formations, clusters) are wishes: they move the action by ``reach`` at most, and robots that
carry or explore can go on. Requirements (speed, distance, fences) have the last word, and no limit. Where two
bind at once, the cone's step keeps neither: what cures the one opposes the other, and is removed.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from msgspec.structs import replace

from edge_runtime.common.vectors import dot, plus
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.projection import cone, weighted_sum
from edge_runtime.guidance.settings import PREFERENCE_RATE, PREFERENCE_STEPS
from edge_runtime.guidance.slopes import ObjectiveError, action_slope
from edge_runtime.messages import GuidedAction, Vector
from edge_runtime.motion.outlook import Outlook

TINY: Final = 1e-300
"""Keeps a length of zero from dividing."""
KEPT: Final = 1e-18
"""A cost of rounding: the requirement is kept."""
LESS: Final = 1.0 - 1e-9
"""What counts as less, lest rounding choose between equals."""
SHARPEST: Final = 0.01
"""Squared sine of the least angle between two boundaries whose corner is gone to: others lie far."""

Descents = Callable[[Sequence[int], Vector], tuple[list[float], list[Vector]]]
"""Costs of the objectives at these places, and the directions -grad J_m in which they fall."""


def corrected(sampled: GuidedAction, outlooks: Sequence[Outlook], guide: Guide, reach: float) -> GuidedAction:
    """Move a finished action at tau = 1: as preferences wish, by ``reach`` at most, then as is required."""
    costs = [0.0] * len(outlooks)

    def descents(members: Sequence[int], action: Vector) -> tuple[list[float], list[Vector]]:
        found = [action_slope(guide.objectives[m], outlooks[m], action) for m in members]
        return [cost for cost, _ in found], [tuple([-g for g in gradient]) for _, gradient in found]

    action, rest = sampled.action, (0.0,) * len(sampled.action)
    try:
        preferred = partial(_preferred, reach)
        for members, move in ((guide.preferences, preferred), (guide.requirements, _required)):
            if members:
                action, found = move(action, guide, descents)
                for m, cost in zip(members, found, strict=True):
                    costs[m] = cost
    except ObjectiveError as error:
        return GuidedAction(
            sampled.action,
            sampled.steps,
            fault=str(error),
            correction=rest,
            cut=sampled.cut,
            objective_failed=True,
        )
    moved = plus(action, -1.0, sampled.action)
    return replace(sampled, action=action, costs=tuple(costs), correction=moved)


def _preferred(reach: float, sampled: Vector, guide: Guide, descents: Descents) -> tuple[Vector, list[float]]:
    """Steps of the weighted sum of all preferences, each back into the ball of radius ``reach``.

    Returns:
        The action, and the costs before the last step.
    """
    weights = [guide.objectives[m].weight for m in guide.preferences]
    action, costs = sampled, list[float]()
    for _ in range(PREFERENCE_STEPS):
        costs, directions = descents(guide.preferences, action)
        move = plus(plus(action, PREFERENCE_RATE, weighted_sum(directions, weights)), -1.0, sampled)
        kept = min(1.0, reach / max(math.hypot(*move), TINY))
        action = plus(sampled, kept, move)
    return action, costs


def _required(action: Vector, guide: Guide, descents: Descents) -> tuple[Vector, list[float]]:
    """Newton steps: of all at once in their common descent cone, then of the one that is violated most.

    None is taken twice in turn if another is violated. Each is linearised anew where the step before led. Of
    the actions that they lead to, the one of the least sum of costs is taken, so that more steps never do
    worse.

    Returns:
        The action, and the costs before it was moved.
    """
    first, directions = descents(guide.requirements, action)
    last, least, place = (0.0,) * len(action), math.inf, -1
    best = action = plus(action, 1.0, cone(directions, (1.0,) * len(directions), last))
    steps = guide.steering.steps
    for _ in range(steps if steps > 1 and any(first) else 0):
        costs, directions = descents(guide.requirements, action)
        total = sum(costs)
        if total < LESS * least:
            best, least = action, total
        violated = [n for n, cost in enumerate(costs) if cost > KEPT]
        if not violated:
            break
        place = max([n for n in violated if n != place] or violated, key=costs.__getitem__)
        action, last = plus(action, 1.0, _step(directions[place], last)), directions[place]
    return best, first


def _step(direction: Vector, last: Vector) -> Vector:
    """A Newton step: along the boundary that the last one led to if it opposes that, as far as keeps both."""
    opposing, last_square = dot(direction, last), dot(last, last)
    if not (opposing < 0.0 < last_square):
        return direction
    along = plus(direction, -opposing / last_square, last)
    square, free = dot(direction, direction), dot(along, along)
    return plus((0.0,) * len(along), square / free, along) if free > SHARPEST * square else direction
