"""The method on one page: an action sampled from the guided flow, for one robot.

At flow time tau, with velocity v and its Jacobian V from one pass through the network:

    a_hat = a + (1 - tau) v                        terminal estimate
    g_m   = -(I + (1 - tau) V)^T grad J_m(a_hat)   eq. 11; grad J_m through the motion model, see slopes.py
    a    <- a + (v + combine(eta lambda, g, v)) / T     eqs. 10 and 12, combined by eqs. 14 and 15

The last line is sampler ``euler``; ``exponential`` needs fewer steps, see `edge_runtime.policy.flow_steps`.

Taken literally, eq. 15 forbids braking: once guidance has moved the action, the flow pulls it back, so what
brakes opposes v and is removed. Mode ``terminal`` keeps the paper's projections while the action is still
being generated and, at tau = 1, where no flow is left to protect, corrects the finished action, see
`edge_runtime.guidance.correction`. Mode ``correction`` does nothing but this: the flow goes its own way, and
needs no Jacobian.

`export.evaluation.guidance` does the same for B robots, `edge_runtime.guidance.native_flow` in the kernel.
"""

import math
import time
from collections.abc import Sequence

import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.common.vectors import descent, dot, plus
from edge_runtime.guidance.correction import corrected
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.native_flow import native_flow
from edge_runtime.guidance.projection import COMBINE, harmonize, project_onto_nominal, weighted_sum
from edge_runtime.guidance.reach import reach_now
from edge_runtime.guidance.slopes import ObjectiveError, action_slope
from edge_runtime.messages import GuidedAction, TeamState, Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.objectives import Objective
from edge_runtime.policy.velocity_field import VelocityField


def guided_action(
    policy: VelocityField,
    observation: Array,
    team: TeamState,
    guide: Guide,
    start: Vector | None = None,
    deadline_s: float = math.inf,
    most_steps: int | None = None,
) -> GuidedAction:
    """Sample one robot's action.

    Anytime: after every step a + (1 - tau) v + guidance / T is a usable action, and after the last one it
    is the sample itself. When another step would end after ``deadline_s``, judged by the longest step so
    far, the newest one is returned. An objective that raises, or whose gradient is not finite, is the
    action's fault.

    Args:
        policy: a velocity field of batch 1, and d action components.
        observation: (1, O).
        team: the robot's own state and its teammates'.
        guide: the objectives, made ready for the policy's motion model.
        start: the flow's start (d,), a sample of the prior; its mean, zero, where None.
        deadline_s: `time.monotonic` time by which the action is needed.
        most_steps: cut short after so many steps, as a deadline would; T where None.

    Raises:
        PolicyError: if the policy cannot be computed.
    """
    rest = (0.0,) * policy.action_dim
    if not math.isfinite(np.add.reduce(observation, axis=None)):  # as its method, a wrapper less
        return GuidedAction(rest, 0, fault="the observation is not finite", correction=rest)
    policy.observe(observation)
    obstacles = guide.sensor.obstacles(team) if guide.sensor else ()
    start = rest if start is None else start
    most_steps = len(policy.schedule) if most_steps is None else most_steps
    if policy.sampler is not None and policy.sampler.knows(guide.steering):
        return _usable(native_flow(policy.sampler, team, obstacles, guide, start, deadline_s, most_steps))
    outlooks = [guide.outlook(place, team, obstacles) for place in range(len(guide.objectives))]
    sampled = _usable(_flow(policy, outlooks, guide, start, deadline_s, most_steps))
    if sampled.fault or not guide.corrected:
        return sampled
    return _usable(corrected(sampled, outlooks, guide, reach_now(guide.asked.guidance, team.tracked)))


def _flow(
    policy: VelocityField,
    outlooks: Sequence[Outlook],
    guide: Guide,
    start: Vector,
    deadline_s: float,
    most_steps: int,
) -> GuidedAction:
    """Take the steps one by one; the observation is set already."""
    bound = list(zip(guide.objectives, outlooks, guide.factors, strict=True)) if guide.steers else []
    action, total, tally, cut = start, len(policy.schedule), _Tally(len(outlooks)), False
    rest = network = (0.0,) * len(start)
    now, longest = time.monotonic(), 0.0
    for k, step in enumerate(policy.schedule):
        left = 1.0 - step.tau
        if bound:
            velocity, *tangents = policy.step(k, (action,))[:, 0].tolist()
        else:
            velocity, tangents = policy.velocity(k, (action,))[0].tolist(), []
        estimate = plus(action, left, velocity)  # a_hat of eq. 10
        try:
            directions, factors, members = _pulled_back(bound, estimate, left, tangents, tally.costs)
        except ObjectiveError as error:
            return GuidedAction(estimate, k, fault=str(error), correction=rest, objective_failed=True)
        conflicting = len(members) > 1 and tally.count_conflicts(directions, members)
        guidance = _combined(guide, directions, factors, velocity, tally, conflicting=conflicting)
        earlier, network = network, tuple(map(step.network, action, velocity))
        action = tuple(map(step.end, action, network, earlier, guidance))  # eq. 12, integrated
        before, now = now, time.monotonic()
        longest = max(longest, now - before)
        cut = k + 1 < total and (now + longest > deadline_s or k + 1 == most_steps)
        if cut:
            action = plus(estimate, step.gain, guidance)
            break
    costs, conflicts = tuple(tally.costs), tuple(tally.conflicts)
    return GuidedAction(
        action, k + 1, costs, tally.projections, "", conflicts, tally.opposed, correction=rest, cut=cut
    )


class _Tally:
    """What is counted along a flow; see `GuidedAction`."""

    def __init__(self, objectives: int) -> None:
        self.costs = [0.0] * objectives
        self.conflicts = [0] * objectives
        self.projections = self.opposed = 0

    def count_conflicts(self, directions: list[Vector], members: list[int]) -> bool:
        """Count every pair of directions that oppose each other, for both objectives; are there any?"""
        found = False
        for m, direction in enumerate(directions):
            for n in range(m):
                if dot(direction, directions[n]) < 0.0:
                    self.conflicts[members[m]] += 1
                    self.conflicts[members[n]] += 1
                    found = True
        return found


def _pulled_back(
    bound: Sequence[tuple[Objective, Outlook, float]],
    estimate: Vector,
    left: float,
    tangents: Sequence[Vector],
    costs: list[float],
) -> tuple[list[Vector], list[float], list[int]]:
    """Directions g_m, factors eta lambda_m and places of the objectives that the estimate does not meet.

    ``tangents`` are dv/da_j, (d,) each.
    """
    directions: list[Vector] = []
    factors: list[float] = []
    members: list[int] = []
    for m, (objective, outlook, factor) in enumerate(bound):
        costs[m], gradient = action_slope(objective, outlook, estimate)
        if any(gradient):
            directions.append(descent(gradient, left, tangents))  # eq. 11
            factors.append(factor)
            members.append(m)
    return directions, factors, members


def _combined(
    guide: Guide,
    directions: list[Vector],
    factors: list[float],
    nominal: Vector,
    tally: _Tally,
    *,
    conflicting: bool,
) -> Vector:
    """The guidance to add to the nominal flow."""
    if not directions:
        return (0.0,) * len(nominal)
    if guide.projection == "hierarchical":
        harmonized = (harmonize if conflicting else weighted_sum)(directions, factors)  # eq. 14
        guidance = project_onto_nominal(harmonized, nominal)  # eq. 15
        opposed = guidance is not harmonized
        tally.opposed += opposed
        tally.projections += conflicting or opposed
    else:
        guidance = COMBINE[guide.projection](directions, factors, nominal)
        tally.projections += guide.projection == "cone" and guidance != weighted_sum(directions, factors)
    return guidance


def _usable(sampled: GuidedAction) -> GuidedAction:
    """Zero where something is wrong. An estimate that is not finite is no objective's fault."""
    finite = math.isfinite(sum(sampled.action))
    if finite and not sampled.fault:
        return sampled
    fault = sampled.fault if finite else "the policy's velocity is not finite"
    failed, rest = finite and sampled.objective_failed, (0.0,) * len(sampled.action)
    return GuidedAction(
        rest, sampled.steps, fault=fault, correction=rest, cut=sampled.cut, objective_failed=failed
    )
