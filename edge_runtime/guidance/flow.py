"""The method on one page: an action sampled from the guided flow, for one planar robot.

At flow time tau = k / T, with velocity v and its Jacobian V from one pass through the network:

    a_hat = a + (1 - tau) v                        terminal estimate
    g_m   = -(I + (1 - tau) V)^T grad J_m(a_hat)   eq. 11
    a    <- a + (v + combine(eta lambda, g, v)) / T     eqs. 10 and 12, combined by eqs. 14 and 15

Taken literally, eq. 15 forbids braking: once guidance has moved the action, the flow pulls it back, so what
brakes opposes v and is removed. Mode ``terminal`` keeps the paper's projections while the action is still
being generated and, at tau = 1, where no flow is left to protect, moves the finished action twice more,

    a <- argmin sum_m lambda_m J_m over the ball of radius ``reach`` around a, approximately,   preferences
    a <- a + cone(1, -grad J(a))                                                                requirements

in Newton steps for costs in squared action units, whatever eta and however contracted the flow.
Preferences (formations, clusters) are wishes: they move the action by ``reach`` at most, and robots that
carry or explore can go on. Requirements (speed, distance, fences) have the last word, and no limit.

`export.evaluation.guidance` does the same for B robots, `edge_runtime.guidance.native_flow` in the kernel.
"""

import math
import time
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from edge_runtime.common.arrays import Array
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.native_flow import native_flow
from edge_runtime.guidance.projection import PLANAR, cone, harmonize, project_onto_nominal, weighted_sum
from edge_runtime.guidance.slopes import ObjectiveError, action_slope
from edge_runtime.messages import GuidedAction, TeamState, Vector, Vector2
from edge_runtime.motion.outlook import Outlook, look_ahead
from edge_runtime.objectives import Objective
from edge_runtime.policy.velocity_field import VelocityField

PREFERENCE_STEPS = 5
PREFERENCE_RATE = 0.5
"""Preferences correct a finished action by so many steps of this share of a Newton step each: several
preferences settle on a compromise, where one step of each would overshoot."""
TINY = 1e-300
"""Keeps a length of zero from dividing."""


def guided_action(
    policy: VelocityField,
    observation: Array,
    team: TeamState,
    guide: Guide,
    start: Vector = (0.0, 0.0),
    deadline_s: float = math.inf,
    most_steps: int | None = None,
) -> GuidedAction:
    """Sample one planar robot's action.

    Anytime: after every step a + (1 - tau) v + guidance / T is a usable action, and after the last one it
    is the sample itself. When another step would end after ``deadline_s``, judged by the longest step so
    far, the newest one is returned. An objective that raises, or whose gradient is not finite, is the
    action's fault.

    Args:
        policy: a velocity field of batch 1 and two action components.
        observation: (1, O).
        team: the robot's own state and its teammates'.
        guide: the objectives.
        start: the flow's start, a sample of the prior.
        deadline_s: `time.monotonic` time by which the action is needed.
        most_steps: cut short after so many steps, as a deadline would; T where None.

    Raises:
        PolicyError: if the policy cannot be computed.
    """
    if not math.isfinite(observation.sum()):
        return GuidedAction((0.0, 0.0), 0, fault="the observation is not finite")
    policy.observe(observation)
    obstacles = guide.sensor.obstacles(team) if guide.sensor else ()
    outlooks = [look_ahead(team, preview, obstacles) for preview in guide.previews]
    sampler, total = policy.sampler, policy.euler_steps
    most_steps = total if most_steps is None else most_steps
    if sampler is not None and sampler.knows(guide.projection, guide.kernel_terms):
        sampled = native_flow(sampler, outlooks, guide, start, deadline_s, total, most_steps)
    else:
        sampled = _flow(policy, outlooks, guide, start, deadline_s, most_steps)
    sampled = _usable(sampled)
    return _usable(_corrected(sampled, outlooks, guide)) if guide.corrected and not sampled.fault else sampled


def _flow(
    policy: VelocityField,
    outlooks: Sequence[Outlook],
    guide: Guide,
    start: Vector,
    deadline_s: float,
    most_steps: int,
) -> GuidedAction:
    """Take the Euler steps one by one; the observation is set already."""
    bound = list(zip(guide.objectives, outlooks, guide.factors, strict=True))
    (ax, ay), total, tally, cut = start, policy.euler_steps, _Tally(len(bound)), False
    now, longest = time.monotonic(), 0.0
    for k in range(total):
        left = 1.0 - k / total
        ((vx, vy),), (along_x,), (along_y,) = policy.step(k, ((ax, ay),)).tolist()
        estimate = ax + left * vx, ay + left * vy  # a_hat of eq. 10
        try:
            directions, factors = _pulled_back(bound, estimate, left, along_x, along_y, tally)
        except ObjectiveError as error:
            return GuidedAction(estimate, k, fault=str(error), objective_failed=True)
        x, y = _combined(guide, directions, factors, (vx, vy), tally)
        ax += (vx + x) / total  # eq. 12, an Euler step of eq. 10
        ay += (vy + y) / total
        before, now = now, time.monotonic()
        longest = max(longest, now - before)
        cut = k + 1 < total and (now + longest > deadline_s or k + 1 == most_steps)
        if cut:
            ax, ay = estimate[0] + x / total, estimate[1] + y / total
            break
    costs, conflicts = tuple(tally.costs), tuple(tally.conflicts)
    return GuidedAction((ax, ay), k + 1, costs, tally.projections, "", conflicts, tally.opposed, cut=cut)


class _Tally:
    """What is counted along a flow; see `GuidedAction`."""

    def __init__(self, objectives: int) -> None:
        self.costs = [0.0] * objectives
        self.conflicts = [0] * objectives
        self.projections = self.opposed = 0

    def count_conflicts(self, directions: list[Vector2], members: list[int]) -> None:
        """Count every pair of directions that oppose each other, for both objectives."""
        for m, (x, y) in enumerate(directions):
            for n in range(m):
                other_x, other_y = directions[n]
                if x * other_x + y * other_y < 0.0:
                    self.conflicts[members[m]] += 1
                    self.conflicts[members[n]] += 1


def _pulled_back(
    bound: Sequence[tuple[Objective, Outlook, float]],
    estimate: Vector2,
    left: float,
    along_x: Vector2,
    along_y: Vector2,
    tally: _Tally,
) -> tuple[list[Vector2], list[float]]:
    """Directions g_m and factors eta lambda_m of the objectives that the estimate does not meet: eq. 11.

    ``along_x`` and ``along_y`` are dv/da_x and dv/da_y.
    """
    (ax, ay), (xx, xy), (yx, yy), costs = estimate, along_x, along_y, tally.costs
    directions: list[Vector2] = []
    factors: list[float] = []
    members: list[int] = []
    for m, (objective, outlook, factor) in enumerate(bound):
        costs[m], gx, gy = action_slope(objective, outlook, ax, ay)
        if gx or gy:
            directions.append((-gx - left * (xx * gx + xy * gy), -gy - left * (yx * gx + yy * gy)))  # eq. 11
            factors.append(factor)
            members.append(m)
    if len(members) > 1:
        tally.count_conflicts(directions, members)
    return directions, factors


def _combined(
    guide: Guide, directions: list[Vector2], factors: list[float], nominal: Vector2, tally: _Tally
) -> Vector2:
    """The guidance to add to the nominal flow."""
    if not directions:
        return 0.0, 0.0
    plain = weighted_sum(directions, factors, nominal)
    if guide.projection == "hierarchical":
        harmonized = harmonize(directions, factors)  # eq. 14
        guidance = project_onto_nominal(harmonized, nominal)  # eq. 15
        tally.opposed += guidance != harmonized
    else:
        guidance = PLANAR[guide.projection](directions, factors, nominal)
    tally.projections += guidance != plain
    return guidance


def _corrected(sampled: GuidedAction, outlooks: Sequence[Outlook], guide: Guide) -> GuidedAction:
    """Move a finished action at tau = 1: as preferences wish, then as is required."""
    costs = [0.0] * len(outlooks)

    def descents(members: Sequence[int], ax: float, ay: float) -> list[Vector2]:
        found = []
        for m in members:
            costs[m], gx, gy = action_slope(guide.objectives[m], outlooks[m], ax, ay)
            found.append((-gx, -gy))
        return found

    ax, ay = sampled.action
    try:
        if guide.preferences:
            ax, ay = _preferred(sampled.action, guide, descents)
        if guide.requirements:
            required = descents(guide.requirements, ax, ay)
            x, y = cone(required, (1.0,) * len(required), (0.0, 0.0))  # a Newton step
            ax, ay = ax + x, ay + y
    except ObjectiveError as error:
        return GuidedAction(
            sampled.action, sampled.steps, fault=str(error), cut=sampled.cut, objective_failed=True
        )
    moved = (ax - sampled.action[0], ay - sampled.action[1])
    return replace(sampled, action=(ax, ay), costs=tuple(costs), correction=moved)


def _preferred(
    sampled: Vector, guide: Guide, descents: Callable[[Sequence[int], float, float], list[Vector2]]
) -> Vector2:
    """Steps of the weighted sum of all preferences, each back into the ball of radius ``reach``."""
    weights = [guide.objectives[m].weight for m in guide.preferences]
    ax, ay = sampled
    for _ in range(PREFERENCE_STEPS):
        x, y = weighted_sum(descents(guide.preferences, ax, ay), weights, (0.0, 0.0))
        x = ax + PREFERENCE_RATE * x - sampled[0]
        y = ay + PREFERENCE_RATE * y - sampled[1]
        kept = min(1.0, guide.asked.guidance.reach / max(math.hypot(x, y), TINY))
        ax, ay = sampled[0] + kept * x, sampled[1] + kept * y
    return ax, ay


def _usable(sampled: GuidedAction) -> GuidedAction:
    """Zero where something is wrong. An estimate that is not finite is no objective's fault."""
    finite = math.isfinite(sampled.action[0] + sampled.action[1])
    if finite and not sampled.fault:
        return sampled
    fault = sampled.fault if finite else "the policy's velocity is not finite"
    failed = finite and sampled.objective_failed
    return GuidedAction((0.0, 0.0), sampled.steps, fault=fault, cut=sampled.cut, objective_failed=failed)
