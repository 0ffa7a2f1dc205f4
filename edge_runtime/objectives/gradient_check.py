"""One call that checks an objective's analytic slope against finite differences of its cost.

Slopes over the predicted motion are the objective's own; through the motion model they become gradients with
respect to the action, which are compared as well.
"""

from collections.abc import Callable, Iterator, Sequence

import msgspec
import numpy as np
from msgspec.structs import replace

from edge_runtime.common.signals import is_interrupt
from edge_runtime.errors import GradientError
from edge_runtime.messages import RobotState, Teammate, TeamState, TrackedObject, Vector
from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Outlook, look_ahead
from edge_runtime.motion.point import PointForce
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives import Objective

OBSTACLES = 2
"""Points that the range sensor sees."""
_STEP = 1e-6
_TOLERANCE = 1e-4
"""Relative to the larger of the slope, the cost and one."""


class GradientReport(msgspec.Struct, frozen=True):
    """What `check_gradient` saw."""

    motions: int
    active: int
    """Motions at which the slope was not zero."""
    worst_error: float
    """Largest disagreement found, relative to the larger of the slope, the cost and one."""


def check_gradient(
    objective: Objective,
    model: Model = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),  # noqa: B008
    teammates: int = 3,
    motions: int = 500,
    extent_m: float = 0.4,
    seed: int = 0,
) -> GradientReport:
    """Compare slope and cost at random motions, among random teammates and obstacles.

    Args:
        objective: what to check.
        model: how the robots move.
        teammates: K neighbours per motion.
        motions: how many random team states.
        extent_m: positions are drawn from a square or cube of this half-width, velocities (m/s) likewise.
        seed: of the random team states.

    Raises:
        GradientError: if a slope is wrong, no motion had one, or the objective raises.
    """
    report = sample_gradient(objective, model, teammates, motions, extent_m, seed)
    if report.active == 0:
        raise GradientError(
            f"{objective.name} was never active in {motions} random motions: choose another extent_m"
        )
    return report


def sample_gradient(
    objective: Objective,
    model: Model,
    teammates: int = 3,
    motions: int = 500,
    extent_m: float = 0.4,
    seed: int = 0,
) -> GradientReport:
    """As `check_gradient`, but an objective that was never active passes.

    Raises:
        GradientError: if a slope is wrong, or the objective raises.
    """
    worst, active = 0.0, 0
    preview = model.preview(objective.look_ahead)
    draw = np.random.default_rng([seed, 1])
    for team, action in _random_teams(model, teammates, motions, extent_m, seed):
        points = draw.uniform(-extent_m, extent_m, (OBSTACLES, 2)).tolist()
        team = replace(team, tracked=tuple(_tracked(objective, extent_m, model.dims, draw)))
        outlook = look_ahead(team, preview, tuple((x, y) for x, y in points))
        error, sloped = compare_slope(objective, outlook, action)
        worst, active = max(worst, error), active + sloped
    return GradientReport(motions, active, worst)


def _tracked(
    objective: Objective, extent_m: float, dims: int, draw: np.random.Generator
) -> Iterator[TrackedObject]:
    """What the objective looks at, somewhere and on its way."""
    for name in objective.looks_at:
        place, velocity = draw.uniform(-extent_m, extent_m, (2, dims)).tolist()
        yield TrackedObject(name, 0.0, tuple(place), tuple(velocity))


def _random_teams(
    model: Model, teammates: int, count: int, extent_m: float, seed: int
) -> Iterator[tuple[TeamState, Vector]]:
    """Teams whose robots move as the model can, and what the robot itself does."""
    draw, dims = np.random.default_rng(seed), model.dims
    for _ in range(count):
        ids = draw.permutation(teammates + 1).tolist()
        motions = draw.uniform(-extent_m, extent_m, (teammates + 1, 2, dims)).tolist()
        turns = draw.uniform(-np.pi, np.pi, (teammates + 1, 2)) * model.turns
        own, *mates = (
            RobotState(robot, 0.0, tuple(position), tuple(velocity), *turn)
            for robot, (position, velocity), turn in zip(ids, motions, turns.tolist(), strict=True)
        )
        action, *intended = map(tuple, draw.uniform(-1.0, 1.0, (1 + teammates, model.action_dim)).tolist())
        yield TeamState(own, tuple(map(Teammate, mates, intended))), action


def compare_slope(objective: Objective, outlook: Outlook, action: Vector) -> tuple[float, bool]:
    """Compare slope and cost at what an action leads to; returns the largest error, and whether it slopes.

    Raises:
        GradientError: names the objective and the component that is wrong, or what it raised.
    """
    try:
        motion, jacobian = outlook.forecast.at(action)
        found = objective.evaluate(motion, outlook)
        cost, *slope = found
        nothing = [0.0] * (len(motion) - len(slope))  # an objective of the plane may leave these out
        over_motion = _worst_error(
            objective,
            lambda moved: objective.evaluate(PredictedMotion(*moved), outlook)[0],
            (cost, motion, [*slope, *nothing], PredictedMotion._fields),
        )
        names = [f"action[{j}]" for j in range(len(action))]
        over_action = _worst_error(
            objective,
            lambda changed: objective.evaluate(outlook.forecast.at(changed)[0], outlook)[0],
            (cost, action, jacobian.pull_back(found), names),
        )
    except GradientError:
        raise
    except BaseException as error:  # one of the user's own may raise anything
        if is_interrupt(error):
            raise
        text = f"objective {objective.name} raised {type(error).__name__}: {error}"
        raise GradientError(" ".join(text.split())) from error
    return max(over_motion, over_action), any(slope)


def _worst_error(
    objective: Objective,
    cost_of: Callable[[Sequence[float]], float],
    stated: tuple[float, Sequence[float], Sequence[float], Sequence[str]],
) -> float:
    """Largest error of what is ``stated``: a cost, where, its derivatives there, and their names."""
    cost, where, slope, names = stated
    worst = 0.0
    for axis, (derivative, name) in enumerate(zip(slope, names, strict=True)):
        ahead, behind = (
            cost_of([value + step * (i == axis) for i, value in enumerate(where)]) for step in (_STEP, -_STEP)
        )
        # At the kink of a hinge the two one-sided differences bracket the slope.
        sides = sorted([(ahead - cost) / _STEP, (cost - behind) / _STEP])
        scale = max(1.0, abs(derivative), abs(cost))
        error = max(sides[0] - derivative, derivative - sides[1], 0.0) / scale
        if not error <= _TOLERANCE:
            raise GradientError(
                f"{objective.name}: d cost / d {name} is stated as {derivative:.6g}, "
                f"finite differences give {sum(sides) / 2:.6g} at {where}"
            )
        worst = max(worst, error)
    return worst
