"""`edge_runtime.guidance.flow` for B robots: the mathematics and its reasons stand there."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.correction import KEPT, LESS, SHARPEST, TINY
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.settings import PREFERENCE_RATE, PREFERENCE_STEPS, GuidanceSettings
from edge_runtime.policy.velocity_field import PYTHON, Sight, Steering, VelocityField
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import OutlookBatch, TeamBatch, look_ahead_batch
from export.evaluation.projection import BATCH, BatchCombine, cone_batch


class Worth(NamedTuple):
    """What actions are worth to their task beside what objectives cost: kappa Q in J - kappa Q."""

    slopes: Callable[[Floats], Floats]
    """B actions (B, d) -> kappa dQ/da (B, d)."""
    first: bool
    """Followed before the preferences instead of against them, within their reach either way."""


def guided_actions(
    policy: VelocityField,
    observation: npt.NDArray[np.float32],
    team: TeamBatch,
    guide: Guide,
    start: Floats,
    combine: BatchCombine | None = None,
    worth: Worth | None = None,
) -> Floats:
    """Sample the actions of B robots: observation (B, O), start (B, d) -> (B, d).

    ``combine`` resolves conflicts along the flow; the guide's own projection where None. ``worth`` counts in
    the correction.

    A policy that takes all steps at once does so for all robots in one call. There is no deadline and no
    check for faults: a non-finite input leaves its own row non-finite.
    """
    policy.observe(observation)
    steering, sampler = guide.steering, policy.sampler
    if combine is None and worth is None and sampler and sampler.knows(steering) and not _in_python(steering):
        action = np.array(start, np.float64)
        sampler.sample_batch(steering, *_views(team, guide), action)
        return action
    outlooks = _outlooks(team, guide)
    action = np.array(start, np.float64)
    guidance = network = np.zeros_like(action)
    factors, combine = np.array(guide.factors), combine or BATCH[guide.projection]
    for k, step in enumerate(policy.schedule):
        if not guide.steers:
            velocity = policy.velocity(k, action).astype(np.float64)
        else:
            result = policy.step(k, action).astype(np.float64)
            velocity, tangents, left = result[0], result[1:], 1.0 - step.tau
            estimate = action + left * velocity
            _, gradients = action_slopes(guide, outlooks, estimate)
            gradients = -(gradients + left * np.einsum("jbi,mbi->mbj", tangents, gradients))
            guidance = combine(gradients, factors, velocity)
        before, network = network, step.network(action, velocity)
        action = step.end(action, network, before, guidance)
    return _corrected(action, outlooks, team, guide, worth)


def unguided_actions(policy: VelocityField, observation: npt.NDArray[np.float32], start: Floats) -> Floats:
    """Sample the actions of B robots that nothing guides: observation (B, O), start (B, d) -> (B, d)."""
    policy.observe(observation)
    action, network = start, np.zeros_like(start)
    for k, step in enumerate(policy.schedule):
        before, network = network, step.network(action, policy.velocity(k, action))
        action = step.end(action, network, before, 0.0)
    return action


def corrected_actions(action: Floats, team: TeamBatch, guide: Guide) -> Floats:
    """Move finished actions (B, d): `edge_runtime.guidance.correction` for B robots."""
    return _corrected(action, _outlooks(team, guide), team, guide, None)


def _outlooks(team: TeamBatch, guide: Guide) -> list[OutlookBatch]:
    """What the objectives see."""
    return [
        look_ahead_batch(team, preview, horizon_s)
        for preview, horizon_s in zip(guide.previews, guide.horizons_s, strict=True)
    ]


def _corrected(
    action: Floats, outlooks: Sequence[OutlookBatch], team: TeamBatch, guide: Guide, worth: Worth | None
) -> Floats:
    reach = reach_batch(guide.asked.guidance, team)
    if worth and worth.first:
        action = _within(action, worth.slopes(action), reach)
    against = worth if worth and not worth.first else None
    if guide.preferences or against:
        action = _preferred(action, outlooks, guide, reach, against)
    if guide.requirements:
        action = _required(action, outlooks, guide)
    return action


def _in_python(steering: Steering) -> bool:
    """Whether an objective is computed there, robot by robot."""
    return any(term.kind == PYTHON for term in steering.terms)


def _views(team: TeamBatch, guide: Guide) -> tuple[Sight, Floats]:
    """What each robot sees in plain numbers (B, V), see `Sampler.sample`."""
    own, mates, robots = team.own, team.mates, len(team.robot_id)
    parts = [team.robot_id[:, None], own.position_m, own.velocity_m_s]
    nothing = np.zeros_like(own.position_m)
    for name in guide.tracked:
        there = team.tracked.get(name)
        places = (there.position_m, there.velocity_m_s) if there else (nothing, nothing)
        parts.append(np.full((robots, 1), float(there is not None)))
        parts += [values[:, : guide.steering.dims] for values in places]
    around = (team.mate_id[..., None], mates.position_m, mates.velocity_m_s, team.mate_action)
    parts.append(np.concatenate(around, -1).reshape(robots, -1))
    parts.append(reach_batch(guide.asked.guidance, team)[:, None])
    return Sight(team.mate_id.shape[1], 0, len(guide.tracked)), np.concatenate(parts, 1)


def reach_batch(guidance: GuidanceSettings, team: TeamBatch) -> Floats:
    """`edge_runtime.guidance.reach.reach_now` for B robots, (B,)."""
    reach = np.full(len(team.robot_id), guidance.reach)
    if guidance.goal_reach is not None and team.left_m is not None:
        reach[team.left_m <= guidance.goal_within_m] = guidance.goal_reach
    return reach


def _preferred(
    sampled: Floats,
    outlooks: Sequence[OutlookBatch],
    guide: Guide,
    reach: Floats,
    against: Worth | None,
) -> Floats:
    """Move finished actions (B, d) as preferences wish, within their reach (B,)."""
    members, weights = (
        list(guide.preferences),
        np.array([guide.objectives[m].weight for m in guide.preferences]),
    )
    action = sampled
    for _ in range(PREFERENCE_STEPS):
        _, slopes = action_slopes(guide, outlooks, action)
        slope = np.einsum("m,mbd->bd", weights, slopes[members])
        if against:
            slope = slope - against.slopes(action)
        action = _within(sampled, action - PREFERENCE_RATE * slope - sampled, reach)
    return action


def _within(sampled: Floats, move: Floats, reach: Floats) -> Floats:
    """Move actions (B, d) by (B, d), as far as their reach (B,)."""
    length = np.linalg.norm(move, axis=-1, keepdims=True)
    moved: Floats = sampled + move * np.minimum(1.0, reach[:, None] / np.maximum(length, TINY))
    return moved


def _required(action: Floats, outlooks: Sequence[OutlookBatch], guide: Guide) -> Floats:
    """Move actions (B, d) as is required."""
    members, rows = list(guide.requirements), np.arange(len(action))
    _, slopes = action_slopes(guide, outlooks, action)
    last = np.zeros_like(action)
    best = action = action + cone_batch(-slopes[members], np.ones(len(members)), last)
    least, place = np.full(len(action), np.inf), np.full(len(action), -1)
    for _ in range(guide.steering.steps):
        costs, slopes = (values[members] for values in action_slopes(guide, outlooks, action))
        total = costs.sum(0)
        better = ~(total >= LESS * least)  # so that what is not finite stays so
        best, least = np.where(better[:, None], action, best), np.where(better, total, least)
        violated = costs > KEPT
        others = violated & (np.arange(len(members))[:, None] != place)
        place = np.where(np.where(others.any(0), others, violated), costs, -1.0).argmax(0)
        direction = np.where(violated.any(0)[:, None], -slopes[place, rows], 0.0)
        action, last = action + _steps(direction, last), direction
    return np.where(np.isfinite(least)[:, None], best, np.nan)


def _steps(direction: Floats, last: Floats) -> Floats:
    """Newton steps (B, d): along the boundary that the last one led to where they oppose that."""
    opposing, last_square, square = (
        (a * b).sum(-1, keepdims=True) for a, b in ((direction, last), (last, last), (direction, direction))
    )
    opposes = (opposing < 0.0) & (last_square > 0.0)
    share = np.divide(opposing, last_square, out=np.zeros_like(opposing), where=opposes)
    along = direction - share * last
    free = np.square(along).sum(-1, keepdims=True)
    corner = opposes & (free > SHARPEST * square)
    stretch = np.divide(square, free, out=np.ones_like(free), where=corner)
    return np.where(corner, stretch * along, direction)


def action_slopes(guide: Guide, outlooks: Sequence[OutlookBatch], action: Floats) -> tuple[Floats, Floats]:
    """J_m (M, B) and dJ_m/da (M, B, d) of B actions, through the motion model."""
    costs, gradients = np.zeros((len(outlooks), len(action))), np.zeros((len(outlooks), *action.shape))
    for m, (objective, outlook) in enumerate(zip(guide.objectives, outlooks, strict=True)):
        motion, jacobian = outlook.at(action)
        slope = evaluate_batch(objective, motion, outlook)
        costs[m], gradients[m] = slope.cost, (jacobian @ slope.d_motion[..., None])[..., 0]
    return costs, gradients
