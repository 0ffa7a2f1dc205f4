"""One call that checks an objective's analytic slope against finite differences of its cost."""

import math

import msgspec
import numpy as np

from edge_runtime.errors import GradientError
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.motion.outlook import Motion, Outlook, OutlookBatch, TeamBatch, look_ahead_batch
from edge_runtime.objectives import Objective, Slope

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
    """Compare slope and cost at random motions, one robot at a time and batched.

    Args:
        objective: what to check.
        dynamics: whose preview the objective is given.
        teammates: K neighbours per motion.
        motions: how many random team states.
        extent_m: positions are drawn from a square of this half-width, velocities (m/s) likewise.
        seed: of the random team states.

    Raises:
        GradientError: if a slope is wrong, the batched form differs, or no motion had a slope.
    """
    outlooks = _random_outlooks(objective, dynamics, teammates, motions, extent_m, seed)
    position, velocity = outlooks.drift_position_m, outlooks.drift_velocity_m_s
    batch = objective.evaluate_batch(position, velocity, outlooks)
    worst, active = 0.0, 0
    for i in range(motions):
        motion, outlook = Motion(*position[i].tolist(), *velocity[i].tolist()), outlooks.row(i)
        slope = objective.evaluate(motion, outlook)
        worst = max(worst, _slope_error(objective, motion, outlook, slope))
        batched = Slope(float(batch.cost[i]), *batch.d_position[i].tolist(), *batch.d_velocity[i].tolist())
        _compare_batched(objective, motion, slope, batched)
        active += any(slope[1:])
    if active == 0:
        raise GradientError(
            f"{objective.name} was never active in {motions} random motions: choose another extent_m"
        )
    return GradientReport(motions, active, worst)


def _random_outlooks(
    objective: Objective, dynamics: Dynamics, teammates: int, motions: int, extent_m: float, seed: int
) -> OutlookBatch:
    draw = np.random.default_rng(seed)
    ids = np.stack([draw.permutation(teammates + 1) for _ in range(motions)])
    positions = draw.uniform(-extent_m, extent_m, (motions, teammates + 1, 2))
    velocities = draw.uniform(-extent_m, extent_m, (motions, teammates + 1, 2))
    team = TeamBatch(
        robot_id=ids[:, 0],
        position_m=positions[:, 0],
        velocity_m_s=velocities[:, 0],
        mate_id=ids[:, 1:],
        mate_position_m=positions[:, 1:],
        mate_velocity_m_s=velocities[:, 1:],
        mate_action=draw.uniform(-1.0, 1.0, (motions, teammates, 2)),
    )
    return look_ahead_batch(team, dynamics.preview(objective.look_ahead))


def _slope_error(objective: Objective, motion: Motion, outlook: Outlook, slope: Slope) -> float:
    worst = 0.0
    for axis, name in enumerate(Motion._fields):
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


def _cost_at(objective: Objective, motion: Motion, outlook: Outlook, axis: int, step: float) -> float:
    values = list(motion)
    values[axis] += step
    return objective.evaluate(Motion(*values), outlook).cost


def _compare_batched(objective: Objective, motion: Motion, single: Slope, batched: Slope) -> None:
    for name, one, many in zip(Slope._fields, single, batched, strict=True):
        if not math.isclose(one, many, rel_tol=1e-9, abs_tol=1e-9):
            raise GradientError(
                f"{objective.name}: evaluate gives {name} = {one:.9g}, "
                f"evaluate_batch gives {many:.9g} at {motion}"
            )
