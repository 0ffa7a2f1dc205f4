"""`edge_runtime.guidance` for B robots at once, in numpy: for evaluations and simulated teams.

The mathematics and its reasons stand there; a test holds the two together.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.guide import Guide
from edge_runtime.policy import VelocityField
from edge_runtime.projection import cone_batch
from edge_runtime.scene import Floats, OutlookBatch, TeamBatch, look_ahead_batch


def guided_actions(
    policy: VelocityField,
    observation: npt.NDArray[np.float32],
    team: TeamBatch,
    guide: Guide,
    start: Floats,
) -> Floats:
    """Sample the actions of B robots: observation (B, O), start (B, d) -> (B, d).

    The objectives act on the first two action components. There is no deadline and no check for faults:
    a non-finite input leaves its own row non-finite.
    """
    policy.observe(observation)
    outlooks = [look_ahead_batch(team, preview) for preview in guide.previews]
    action, total = np.array(start, np.float64), policy.euler_steps
    factors = np.array(guide.factors)
    for k in range(total):
        result = policy.step(k, action).astype(np.float64)
        velocity, tangents, left = result[0], result[1:], 1.0 - k / total
        guidance = np.zeros_like(action)
        if outlooks:
            estimate = action + left * velocity
            gradients = action_slopes(guide, outlooks, estimate)
            gradients = -(gradients + left * np.einsum("jbi,mbi->mbj", tangents, gradients))
            guidance = guide.combine_batch(gradients, factors, velocity)
        action += (velocity + guidance) / total
    if guide.corrects:
        descent = -action_slopes(guide, outlooks, action)
        action += cone_batch(descent, np.ones(len(descent)), np.zeros_like(action))
    return action


def action_slopes(guide: Guide, outlooks: Sequence[OutlookBatch], action: Floats) -> Floats:
    """dJ_m/da (M, B, d) of B actions, through the dynamics previews."""
    gradients = np.zeros((len(outlooks), *action.shape))
    planar = action[:, :2]
    for gradient, objective, outlook in zip(gradients, guide.objectives, outlooks, strict=True):
        shift, push = outlook.preview.position_gain, outlook.preview.velocity_gain
        slope = objective.evaluate_batch(
            outlook.drift_position_m + shift * planar, outlook.drift_velocity_m_s + push * planar, outlook
        )
        gradient[:, :2] = shift * slope.d_position + push * slope.d_velocity
    return gradients
