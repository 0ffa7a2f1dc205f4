"""`edge_runtime.guidance.flow` for B robots: the mathematics and its reasons stand there."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.flow import TINY
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.settings import PREFERENCE_RATE, PREFERENCE_STEPS
from edge_runtime.policy.velocity_field import PYTHON, Sight, Steering, VelocityField
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import OutlookBatch, TeamBatch, look_ahead_batch
from export.evaluation.projection import BATCH, BatchCombine, cone_batch


def guided_actions(
    policy: VelocityField,
    observation: npt.NDArray[np.float32],
    team: TeamBatch,
    guide: Guide,
    start: Floats,
    combine: BatchCombine | None = None,
) -> Floats:
    """Sample the actions of B robots: observation (B, O), start (B, d) -> (B, d).

    ``combine`` resolves conflicts along the flow; the guide's own projection where None.

    A policy that takes all steps at once does so for all robots in one call. There is no deadline and no
    check for faults: a non-finite input leaves its own row non-finite.
    """
    policy.observe(observation)
    steering, sampler = guide.steering, policy.sampler
    if combine is None and sampler and sampler.knows(steering) and not _in_python(steering):
        action = np.array(start, np.float64)
        sampler.sample_batch(steering, *_views(team, guide), action)
        return action
    outlooks = [
        look_ahead_batch(team, preview, horizon_s)
        for preview, horizon_s in zip(guide.previews, guide.horizons_s, strict=True)
    ]
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
            gradients = action_slopes(guide, outlooks, estimate)
            gradients = -(gradients + left * np.einsum("jbi,mbi->mbj", tangents, gradients))
            guidance = combine(gradients, factors, velocity)
        before, network = network, step.network(action, velocity)
        action = step.end(action, network, before, guidance)
    if guide.preferences:
        action = _preferred(action, outlooks, guide)
    if guide.requirements:
        descent = -action_slopes(guide, outlooks, action)[list(guide.requirements)]
        action += cone_batch(descent, np.ones(len(descent)), np.zeros_like(action))
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
    return Sight(team.mate_id.shape[1], 0, len(guide.tracked)), np.concatenate(parts, 1)


def _preferred(sampled: Floats, outlooks: Sequence[OutlookBatch], guide: Guide) -> Floats:
    """Move finished actions (B, d) as preferences wish, within ``reach``."""
    members, weights = (
        list(guide.preferences),
        np.array([guide.objectives[m].weight for m in guide.preferences]),
    )
    action = sampled
    for _ in range(PREFERENCE_STEPS):
        slopes = action_slopes(guide, outlooks, action)[members]
        move = action - PREFERENCE_RATE * np.einsum("m,mbd->bd", weights, slopes) - sampled
        length = np.linalg.norm(move, axis=-1, keepdims=True)
        action = sampled + move * np.minimum(1.0, guide.asked.guidance.reach / np.maximum(length, TINY))
    return action


def action_slopes(guide: Guide, outlooks: Sequence[OutlookBatch], action: Floats) -> Floats:
    """dJ_m/da (M, B, d) of B actions, through the motion model."""
    gradients = np.zeros((len(outlooks), *action.shape))
    for m, (objective, outlook) in enumerate(zip(guide.objectives, outlooks, strict=True)):
        motion, jacobian = outlook.at(action)
        slope = evaluate_batch(objective, motion, outlook)
        gradients[m] = (jacobian @ slope.d_motion[..., None])[..., 0]
    return gradients
