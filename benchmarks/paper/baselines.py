"""What post-processes a finished action towards the execution objectives, after the paper's section V-A.

Both start from the action a_0 that a trained MAPPO policy predicts; a(k) below are the B robots' actions.

- Projected gradient descent: n steps a <- P(a - alpha sum_m lambda_m grad J_m(a)), where P projects onto
  the ball of radius rho around a_0; rho may be another where what is carried is at its goal.
- Shielding: a_0 stays where every cost is zero; elsewhere it is moved onto the safe set, the actions of
  zero cost, by cyclic projections. A cost here is half the squared action that would cure its violation,
  so that a - grad J is the projection onto one objective's safe set. The last point is taken.
"""

from collections.abc import Sequence

import numpy as np

from benchmarks.paper.settings import Descent, Shield
from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.settings import GuidanceSettings
from export.evaluation.guidance import action_slopes, reach_batch
from export.evaluation.outlook import OutlookBatch


def descend(settings: Descent, action: Floats, guide: Guide, outlooks: Sequence[OutlookBatch]) -> Floats:
    """Projected gradient descent from actions (B, 2)."""
    moved, factors = action.copy(), np.array(guide.factors)
    ball = GuidanceSettings(reach=settings.radius, goal_reach=settings.goal_radius)
    radius = reach_batch(ball, outlooks[0].team)[:, None]
    for _ in range(settings.steps):
        _, slopes = action_slopes(guide, outlooks, moved)
        away = moved - settings.rate * np.einsum("m,mbd->bd", factors, slopes) - action
        length = np.linalg.norm(away, axis=-1, keepdims=True)
        moved = action + away * np.minimum(1.0, radius / np.maximum(length, radius))
    return moved


def shield(settings: Shield, action: Floats, guide: Guide, outlooks: Sequence[OutlookBatch]) -> Floats:
    """Move actions (B, 2) onto the safe set."""
    moved = action.copy()
    for _ in range(settings.rounds):
        for m in range(len(outlooks)):
            moved -= action_slopes(guide, outlooks, moved)[1][m]
    return moved
