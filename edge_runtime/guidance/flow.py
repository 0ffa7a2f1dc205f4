"""Sampling an action from the guided flow: T Euler steps of eqs. 10 to 12 with the projections of IV-C.

At flow time tau = k / T, with velocity v and its Jacobian V from one pass through the network:

    a_hat = a + (1 - tau) v                      terminal estimate
    g_m   = -(I + (1 - tau) V)^T grad J_m(a_hat)   eq. 11
    a    <- a + (v + combine(eta lambda, g, v)) / T

Taken literally, eq. 15 forbids braking: once guidance has moved the action, the flow pulls it back, so what
brakes opposes v and is removed. Mode ``terminal`` keeps the paper's projections while the action is still
being generated and, at tau = 1, where no flow is left to protect, moves the finished action twice more,

    a <- argmin sum_m lambda_m J_m over the ball of radius ``reach`` around a, approximately,   preferences
    a <- a + cone(1, -grad J(a))                                                                requirements

in Newton steps for costs in squared action units, whatever eta and however contracted the flow.
Preferences (formations, clusters) are wishes: they move the action by ``reach`` at most, and robots that
carry or explore can go on. Requirements (speed, distance, fences) have the last word, and no limit.

This is for one planar robot; `export.evaluation.guidance` serves B robots.
"""

import math
import time
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.projection import PLANAR, cone, harmonize, project_onto_nominal, weighted_sum
from edge_runtime.messages import GuidedAction, TeamState, Vector2
from edge_runtime.motion.outlook import Outlook, PredictedMotion, look_ahead
from edge_runtime.objectives import Objective
from edge_runtime.policy.compiled_policy import CompiledPolicy, encode
from edge_runtime.policy.numpy_policy import VelocityField

__all__ = ["GuidedAction", "guided_action"]

PREFERENCE_STEPS = 5
PREFERENCE_RATE = 0.5
"""Preferences correct a finished action by so many steps of this share of a Newton step each: several
preferences settle on a compromise, where one step of each would overshoot."""

TINY = 1e-300
"""Keeps a length of zero from dividing."""


def guided_action(
    policy: VelocityField,
    observation: npt.NDArray[np.float32],
    team: TeamState,
    guide: Guide,
    start: Vector2 = (0.0, 0.0),
    deadline_s: float = math.inf,
    most_steps: int | None = None,
) -> GuidedAction:
    """Sample one planar robot's action.

    Anytime: after every step a + (1 - tau) v + guidance / T is a usable action, and after the last one it
    is the sample itself. When another step would end after ``deadline_s``, judged by the longest step so
    far, the newest one is returned.

    Args:
        policy: a velocity field of batch 1 and two action components.
        observation: (1, O).
        team: the robot's own state and its teammates'.
        guide: the objectives.
        start: the flow's start, a sample of the prior.
        deadline_s: `time.monotonic` time by which the action is needed.
        most_steps: cut short after so many steps, as a deadline would; T where None.
    """
    if not math.isfinite(observation.sum()):
        return _refused(0, "the observation is not finite")
    policy.observe(observation)
    outlooks = [look_ahead(team, preview) for preview in guide.previews]
    try:
        if guide.native and isinstance(policy, CompiledPolicy):
            sampled = _flow_compiled(policy, outlooks, guide, start, deadline_s, most_steps)
        else:
            sampled = _flow(policy, outlooks, guide, start, deadline_s, most_steps)
        return _corrected(sampled, outlooks, guide) if guide.corrected and not sampled.fault else sampled
    except Exception as error:  # noqa: BLE001  # an objective of the user's own may raise anything
        return _refused(0, f"an objective raised {type(error).__name__}: {error}")


def _flow(
    policy: VelocityField,
    outlooks: Sequence[Outlook],
    guide: Guide,
    start: Vector2,
    deadline_s: float,
    most_steps: int | None,
) -> GuidedAction:
    """Take the Euler steps; the observation is set already."""
    bound = list(zip(guide.objectives, outlooks, guide.factors, strict=True))
    (ax, ay), total, projections, opposed, cut = start, policy.euler_steps, 0, 0, False
    costs: list[float] = []
    steering: list[tuple[int, float, float]] = []
    conflicts = [0] * len(bound)
    combine = PLANAR[guide.projection]
    now, longest = time.monotonic(), 0.0
    for k in range(total):
        ((vx, vy),), ((jxx, jxy),), ((jyx, jyy),) = policy.step(k, ((ax, ay),)).tolist()
        left = 1.0 - k / total
        hx, hy = ax + left * vx, ay + left * vy
        gradients, factors, sum_x, sum_y = [], [], 0.0, 0.0
        costs.clear()
        steering.clear()
        for objective, outlook, factor in bound:
            cost, gx, gy = _action_slope(objective, outlook, hx, hy)
            if not math.isfinite(gx + gy):
                return _refused(k, f"the gradient of {objective.name} is not finite")
            if gx or gy:
                x, y = -gx - left * (jxx * gx + jxy * gy), -gy - left * (jyx * gx + jyy * gy)
                for n, nx, ny in steering:
                    if x * nx + y * ny < 0.0:
                        conflicts[n] += 1
                        conflicts[len(costs)] += 1
                steering.append((len(costs), x, y))
                gradients.append((x, y))
                factors.append(factor)
                sum_x += factor * x
                sum_y += factor * y
            costs.append(cost)
        ex = ey = 0.0
        if gradients:
            if guide.projection == "hierarchical":  # `hierarchical` in its two steps
                harmonized = harmonize(gradients, factors)
                ex, ey = project_onto_nominal(harmonized, (vx, vy))
                opposed += (ex, ey) != harmonized
            else:
                ex, ey = combine(gradients, factors, (vx, vy))
            projections += (ex, ey) != (sum_x, sum_y)
        ax += (vx + ex) / total
        ay += (vy + ey) / total
        before, now = now, time.monotonic()
        longest = max(longest, now - before)
        cut = k + 1 < total and (now + longest > deadline_s or k + 1 == most_steps)
        if cut:
            ax, ay = hx + ex / total, hy + ey / total
            break
    return _finished(
        GuidedAction((ax, ay), k + 1, tuple(costs), projections, "", tuple(conflicts), opposed, cut=cut)
    )


def _flow_compiled(
    policy: CompiledPolicy,
    outlooks: Sequence[Outlook],
    guide: Guide,
    start: Vector2,
    deadline_s: float,
    most_steps: int | None,
) -> GuidedAction:
    """`_flow` in the compiled kernel."""
    terms = [encode(*term) for term in zip(guide.objectives, outlooks, guide.factors, strict=True)]
    most_steps = policy.euler_steps if most_steps is None else most_steps
    sample = policy.sample(guide.projection, terms, start, deadline_s - time.monotonic(), most_steps)
    if sample.fault >= 0:
        return _refused(sample.steps, f"the gradient of {guide.objectives[sample.fault].name} is not finite")
    cut = sample.steps < policy.euler_steps
    return _finished(
        GuidedAction(
            sample.action,
            sample.steps,
            sample.costs,
            sample.projections,
            "",
            sample.conflicts,
            sample.opposed,
            cut=cut,
        )
    )


def _corrected(sampled: GuidedAction, outlooks: Sequence[Outlook], guide: Guide) -> GuidedAction:
    """Move a finished action at tau = 1: as preferences wish, within ``reach``; then as is required."""
    costs = [0.0] * len(outlooks)
    weights = [guide.objectives[m].weight for m in guide.preferences]
    reach = guide.asked.guidance.reach

    def slopes(members: Sequence[int], ax: float, ay: float) -> list[Vector2]:
        gradients = []
        for m in members:
            costs[m], gx, gy = _action_slope(guide.objectives[m], outlooks[m], ax, ay)
            if not math.isfinite(gx + gy):
                raise _NotFiniteError(guide.objectives[m].name)
            gradients.append((-gx, -gy))
        return gradients

    try:
        ax, ay = sampled.action
        for _ in range(PREFERENCE_STEPS if guide.preferences else 0):
            gradients = slopes(guide.preferences, ax, ay)
            x, y = weighted_sum(gradients, weights, (0.0, 0.0))
            x = ax + PREFERENCE_RATE * x - sampled.action[0]
            y = ay + PREFERENCE_RATE * y - sampled.action[1]
            kept = min(1.0, reach / max(math.hypot(x, y), TINY))
            ax, ay = sampled.action[0] + kept * x, sampled.action[1] + kept * y
        if guide.requirements:
            gradients = slopes(guide.requirements, ax, ay)
            x, y = cone(gradients, (1.0,) * len(gradients), (0.0, 0.0))
            ax, ay = ax + x, ay + y
    except _NotFiniteError as error:
        return _refused(sampled.steps, f"the gradient of {error} is not finite", cut=sampled.cut)
    return _finished(
        GuidedAction(
            (ax, ay),
            sampled.steps,
            tuple(costs),
            sampled.projections,
            "",
            sampled.conflicts,
            sampled.opposed,
            (ax - sampled.action[0], ay - sampled.action[1]),
            sampled.cut,
        )
    )


class _NotFiniteError(Exception):
    """An objective, by its name, has no usable gradient."""


def _action_slope(objective: Objective, outlook: Outlook, ax: float, ay: float) -> tuple[float, float, float]:
    """Cost of an action and its derivatives, through the dynamics preview."""
    x, y, vx, vy = outlook.drift
    shift, push = outlook.preview.position_gain, outlook.preview.velocity_gain
    motion = PredictedMotion(x + shift * ax, y + shift * ay, vx + push * ax, vy + push * ay)
    cost, d_x, d_y, d_vx, d_vy = objective.evaluate(motion, outlook)
    return cost, shift * d_x + push * d_vx, shift * d_y + push * d_vy


def _finished(sampled: GuidedAction) -> GuidedAction:
    if not math.isfinite(sampled.action[0] + sampled.action[1]):
        return _refused(sampled.steps, "the policy's velocity is not finite", cut=sampled.cut)
    return sampled


def _refused(steps: int, fault: str, *, cut: bool = False) -> GuidedAction:
    return GuidedAction((0.0, 0.0), steps, fault=fault, cut=cut)
