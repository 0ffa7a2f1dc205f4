"""How B robots decide, on the deployed numpy runtime: guided flows, and what the paper compares them with."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from benchmarks.paper.episodes import Decide, MakeDecide
from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.guide import Guide, make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.objectives import Objective
from edge_runtime.policy.bundle import Bundle
from export.evaluation.guidance import guided_actions
from export.evaluation.outlook import OutlookBatch, TeamBatch, look_ahead_batch
from export.evaluation.projection import BatchCombine

Observations = npt.NDArray[np.float32]
Adapt = Callable[[Floats, Guide, Sequence[OutlookBatch]], Floats]
"""Finished actions (B, 2), objectives and what they see -> actions (B, 2)."""
Preference = tuple[float, float, float]
Shape = Callable[[Guide], Guide]
"""Changes a guide in what its settings do not offer."""


def as_it_is(guide: Guide) -> Guide:
    """No change."""
    return guide


def guided(
    settings: GuidanceSettings,
    objectives: tuple[Objective, ...],
    bundle: Bundle,
    euler_steps: int | None = None,
    shape: Shape = as_it_is,
    combine: BatchCombine | None = None,
) -> MakeDecide:
    """A flow policy under guidance; a Gaussian one, whose flow starts at zero, gives its mean.

    ``combine`` resolves conflicts along the flow; the guide's own projection where None.
    """
    guide = shape(make_guide(ObjectiveSet(objectives, settings), bundle.manifest.dynamics))

    def prepare(batch: int) -> Decide:
        policy = bundle.policy(batch, euler_steps)

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            start = settings.start_noise * draw.standard_normal((batch, 2))
            return guided_actions(policy, observation, views, guide, start, combine)

        return decide

    return prepare


def unguided(bundle: Bundle, start_noise: float) -> MakeDecide:
    """A policy left alone."""
    return guided(GuidanceSettings(mode="none", scale=0.0, start_noise=start_noise), (), bundle)


def post_processed(adapt: Adapt, objectives: tuple[Objective, ...], bundle: Bundle) -> MakeDecide:
    """A Gaussian policy whose mean action is adapted afterwards."""
    guide = make_guide(
        ObjectiveSet(objectives, GuidanceSettings(mode="none", scale=1.0)), bundle.manifest.dynamics
    )
    predict = unguided(bundle, 0.0)

    def prepare(batch: int) -> Decide:
        mean = predict(batch)

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            outlooks = [look_ahead_batch(views, preview) for preview in guide.previews]
            return adapt(mean(observation, views, draw), guide, outlooks)

        return decide

    return prepare


def preferring(preference: Preference, bundle: Bundle) -> MakeDecide:
    """A Gaussian policy that observes a preference for each objective, the nominal one first."""
    predict = unguided(bundle, 0.0)

    def prepare(batch: int) -> Decide:
        mean, column = predict(batch), np.tile(np.array(preference, np.float32), (batch, 1))

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            return mean(np.concatenate([observation, column], 1), views, draw)

        return decide

    return prepare
