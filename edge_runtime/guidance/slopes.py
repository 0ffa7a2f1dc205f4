"""What an action costs an objective, and what its own code may get wrong on the way."""

import math
from collections.abc import Sequence

from edge_runtime.common.signals import is_interrupt
from edge_runtime.motion.outlook import Outlook, PredictedMotion
from edge_runtime.objectives import Objective


class ObjectiveError(Exception):
    """An objective that cannot guide: it raised, or has no finite gradient. Stops the robot in that tick."""


def action_slope(objective: Objective, outlook: Outlook, ax: float, ay: float) -> tuple[float, float, float]:
    """Cost of an action and its gradient, through the dynamics' preview.

    Raises:
        ObjectiveError: names the objective and what it raised, or that its gradient is not finite.
    """
    x, y, vx, vy = outlook.drift
    shift, push = outlook.preview.position_gain, outlook.preview.velocity_gain
    motion = PredictedMotion(x + shift * ax, y + shift * ay, vx + push * ax, vy + push * ay)
    try:
        cost, d_x, d_y, d_vx, d_vy = objective.evaluate(motion, outlook)
        # What it computes with may be numbers of another library, which no record could keep.
        cost, gx, gy = float(cost), float(shift * d_x + push * d_vx), float(shift * d_y + push * d_vy)
    except BaseException as error:  # one of the user's own may raise anything
        raise _raised(objective, error) from error
    if not math.isfinite(cost + gx + gy):
        raise not_finite(objective)
    return cost, gx, gy


def encoded(objective: Objective, outlook: Outlook) -> Sequence[float]:
    """The numbers of which a policy's sampler computes the cost.

    Raises:
        ObjectiveError: names the objective and what it raised.
    """
    try:
        return objective.encode(outlook)
    except BaseException as error:  # one of the user's own may raise anything
        raise _raised(objective, error) from error


def not_finite(objective: Objective) -> ObjectiveError:
    """An objective without a finite cost and gradient."""
    return ObjectiveError(f"the gradient of {objective.name} is not finite")


def _raised(objective: Objective, error: BaseException) -> BaseException:
    text = f"objective {objective.name} raised {type(error).__name__}: {error}"
    return error if is_interrupt(error) else ObjectiveError(text)
