"""What an action costs an objective, and what its own code may get wrong on the way."""

import math
from collections.abc import Sequence

from edge_runtime.common.signals import is_interrupt
from edge_runtime.messages import Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.objectives import Objective


class ObjectiveError(Exception):
    """An objective that cannot guide: it raised, or has no finite gradient. Stops the robot in that tick."""


def action_slope(objective: Objective, outlook: Outlook, action: Sequence[float]) -> tuple[float, Vector]:
    """Cost of an action (d,) and its gradient (d,), through the motion model.

    Raises:
        ObjectiveError: names the objective and what it raised, or that its gradient is not finite.
    """
    motion, jacobian = outlook.forecast.at(action)
    try:
        slope = objective.evaluate(motion, outlook)
        gradient, cost = jacobian.pull_back(slope), slope[0]
        total = cost + sum(gradient)
        if not type(cost) is type(total) is float:
            # It may compute with numbers of another library, which no record could keep.
            gradient, cost, total = tuple(map(float, gradient)), float(cost), float(total)
    except BaseException as error:  # one of the user's own may raise anything
        raise _raised(objective, error) from error
    if not math.isfinite(total):
        raise not_finite(objective)
    return cost, gradient


def not_finite(objective: Objective) -> ObjectiveError:
    """An objective without a finite cost and gradient."""
    return ObjectiveError(f"the gradient of {objective.name} is not finite")


def _raised(objective: Objective, error: BaseException) -> BaseException:
    text = f"objective {objective.name} raised {type(error).__name__}: {error}"
    return error if is_interrupt(error) else ObjectiveError(text)
