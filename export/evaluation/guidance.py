"""`edge_runtime.guidance.flow` for B robots: the mathematics and its reasons stand there."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.flow import PREFERENCE_RATE, PREFERENCE_STEPS, TINY
from edge_runtime.guidance.guide import Guide
from edge_runtime.policy.velocity_field import VelocityField
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

    There is no deadline and no check for faults: a non-finite input leaves its own row non-finite.
    """
    policy.observe(observation)
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
