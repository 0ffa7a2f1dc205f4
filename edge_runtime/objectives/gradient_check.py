"""One call that checks an objective's analytic slope against finite differences of its cost."""

from collections.abc import Iterator

import msgspec
import numpy as np

from edge_runtime.common.signals import is_interrupt
from edge_runtime.errors import GradientError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.motion.outlook import Outlook, PredictedMotion, look_ahead
from edge_runtime.objectives import Objective, Slope

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
    dynamics: Dynamics = Dynamics(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),  # noqa: B008
    teammates: int = 3,
    motions: int = 500,
    extent_m: float = 0.4,
    seed: int = 0,
) -> GradientReport:
    """Compare slope and cost at random motions, among random teammates and obstacles.

    Args:
        objective: what to check.
        dynamics: whose preview the objective is given.
        teammates: K neighbours per motion.
        motions: how many random team states.
        extent_m: positions are drawn from a square of this half-width, velocities (m/s) likewise.
        seed: of the random team states.

    Raises:
        GradientError: if a slope is wrong, no motion had one, or the objective raises.
    """
    report = sample_gradient(objective, dynamics, teammates, motions, extent_m, seed)
    if report.active == 0:
        raise GradientError(
            f"{objective.name} was never active in {motions} random motions: choose another extent_m"
        )
    return report


def sample_gradient(
    objective: Objective,
    dynamics: Dynamics,
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
    preview = dynamics.preview(objective.look_ahead)
    draw = np.random.default_rng([seed, 1])
    for team in _random_teams(teammates, motions, extent_m, seed):
        points = draw.uniform(-extent_m, extent_m, (OBSTACLES, 2)).tolist()
        outlook = look_ahead(team, preview, tuple((x, y) for x, y in points))
        error, sloped = compare_slope(objective, outlook.drift, outlook)
        worst, active = max(worst, error), active + sloped
    return GradientReport(motions, active, worst)


def _random_teams(teammates: int, count: int, extent_m: float, seed: int) -> Iterator[TeamState]:
    draw = np.random.default_rng(seed)
    for _ in range(count):
        ids = draw.permutation(teammates + 1).tolist()
        motions = draw.uniform(-extent_m, extent_m, (teammates + 1, 2, 2)).tolist()
        own, *mates = (
            RobotState(robot, 0.0, tuple(position), tuple(velocity))
            for robot, (position, velocity) in zip(ids, motions, strict=True)
        )
        actions = draw.uniform(-1.0, 1.0, (teammates, 2)).tolist()
        yield TeamState(own, tuple(Teammate(mate, tuple(u)) for mate, u in zip(mates, actions, strict=True)))


def compare_slope(objective: Objective, motion: PredictedMotion, outlook: Outlook) -> tuple[float, bool]:
    """Compare slope and cost at one motion; returns the largest error, and whether there is a slope.

    Raises:
        GradientError: names the objective and the component that is wrong, or what it raised.
    """
    try:
        slope = objective.evaluate(motion, outlook)
        return _slope_error(objective, motion, outlook, slope), any(slope[1:])
    except GradientError:
        raise
    except BaseException as error:  # one of the user's own may raise anything
        if is_interrupt(error):
            raise
        text = f"objective {objective.name} raised {type(error).__name__}: {error}"
        raise GradientError(" ".join(text.split())) from error


def _slope_error(objective: Objective, motion: PredictedMotion, outlook: Outlook, slope: Slope) -> float:
    worst = 0.0
    for axis, name in enumerate(PredictedMotion._fields):
        ahead = _cost_at(objective, motion, outlook, axis, _STEP)
        behind = _cost_at(objective, motion, outlook, axis, -_STEP)
        # At the kink of a hinge the two one-sided differences bracket the slope.
        sides = sorted([(ahead - slope.cost) / _STEP, (slope.cost - behind) / _STEP])
        stated = slope[1 + axis]
        scale = max(1.0, abs(stated), abs(slope.cost))
        error = max(sides[0] - stated, stated - sides[1], 0.0) / scale
        if not error <= _TOLERANCE:
            raise GradientError(
                f"{objective.name}: d cost / d {name} is stated as {stated:.6g}, "
                f"finite differences give {sum(sides) / 2:.6g} at {motion}"
            )
        worst = max(worst, error)
    return worst


def _cost_at(
    objective: Objective, motion: PredictedMotion, outlook: Outlook, axis: int, step: float
) -> float:
    values = list(motion)
    values[axis] += step
    return objective.evaluate(PredictedMotion(*values), outlook).cost
