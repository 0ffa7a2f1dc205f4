"""Several guided flows per robot from different start noise, of which the best is taken.

A sample's score is the weighted cost of its finished action plus half the squared norm of its start, which
is its negative log-likelihood up to a constant: the trade of eq. 13 among finished samples. Robots choose
each for itself, or a team chooses one index for all, then judged by what everybody does under that index.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from benchmarks.paper.ablation.views import rows_of
from benchmarks.paper.episodes import Decide, MakeDecide
from benchmarks.paper.methods import Observations
from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.guide import Guide, make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.objectives import Objective
from edge_runtime.policy.bundle import Bundle
from export.evaluation.guidance import guided_actions
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import OutlookBatch, TeamBatch, look_ahead_batch


def best_of(
    settings: GuidanceSettings,
    objectives: tuple[Objective, ...],
    samples: int,
    team: int | None,
    bundle: Bundle,
) -> MakeDecide:
    """A guided flow that samples S times and takes the best.

    Args:
        settings: of guidance.
        objectives: what guides and scores.
        samples: S.
        team: N, the robots of a team that chooses together; None where each robot chooses for itself.
        bundle: the policy.
    """
    guide = make_guide(ObjectiveSet(objectives, settings), bundle.manifest.dynamics)
    low, high = ([getattr(field, end) for field in bundle.manifest.action] for end in ("low", "high"))

    def prepare(batch: int) -> Decide:
        policy, everyone = bundle.policy(samples * batch), np.tile(np.arange(batch), samples)

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            start = settings.start_noise * draw.standard_normal((samples * batch, 2))
            seen = rows_of(views, everyone)
            action = guided_actions(policy, observation[everyone], seen, guide, start)
            action = np.clip(action, low, high)
            if team is not None:
                seen = replace(seen, mate_action=mates_actions(action, seen.mate_id, team))
            outlooks = [look_ahead_batch(seen, preview) for preview in guide.previews]
            score = action_costs(guide, outlooks, action) + 0.5 * np.square(start).sum(-1)
            choice = cheapest(score.reshape(samples, batch), team or 1)
            return action.reshape(samples, batch, 2)[choice, np.arange(batch)]

        return decide

    return prepare


def cheapest(score: Floats, team: int) -> npt.NDArray[np.int64]:
    """Indices (B,) of the samples with the least score (S, B), the same for all of a team's ``team`` rows."""
    total = score.reshape(len(score), -1, team).sum(-1)
    return np.repeat(total.argmin(0), team)


def mates_actions(action: Floats, mate_id: npt.NDArray[np.int64], team: int) -> Floats:
    """Actions (R, K, 2) of the teammates (R, K), from all actions (R, 2), a team's in consecutive rows."""
    first = np.arange(len(action)) // team * team
    return action[first[:, None] + mate_id]


def action_costs(guide: Guide, outlooks: Sequence[OutlookBatch], action: Floats) -> Floats:
    """sum_m lambda_m J_m (B,) of B finished actions, through the dynamics previews."""
    total = np.zeros(len(action))
    for objective, outlook in zip(guide.objectives, outlooks, strict=True):
        shift, push = outlook.preview.position_gain, outlook.preview.velocity_gain
        position = outlook.drift_position_m + shift * action
        velocity = outlook.drift_velocity_m_s + push * action
        total += objective.weight * evaluate_batch(objective, position, velocity, outlook).cost
    return total
