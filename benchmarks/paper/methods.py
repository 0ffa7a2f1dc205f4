"""How B robots decide, on the deployed runtime: guided flows, and what the paper compares them with."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from msgspec.structs import replace

from benchmarks.paper.baselines import descend, shield
from benchmarks.paper.policies import digest, value_path
from benchmarks.paper.settings import Descent, Guided, Mean, Settings, Shield
from benchmarks.paper.tasks import Task
from edge_runtime.common.arrays import Array, Floats
from edge_runtime.guidance.guide import Guide, make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.objectives import Objective
from edge_runtime.policy.backend import make_policy
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.velocity_field import VelocityField
from export.episodes.belief import believing
from export.episodes.carried import carrying
from export.episodes.ease import eased
from export.episodes.play import Decide, MakeDecide, Observations, sampled
from export.evaluation.guidance import Worth
from export.evaluation.outlook import OutlookBatch, TeamBatch, look_ahead_batch
from export.evaluation.projection import BatchCombine, hierarchical_batch
from export.values.action_value import load_value

Adapt = Callable[[Floats, Guide, Sequence[OutlookBatch]], Floats]
"""Finished actions (B, 2), objectives and what they see -> actions (B, 2)."""


def decider(task: Task, settings: Settings, bundle: Bundle) -> MakeDecide:
    """What a method decides with a policy."""
    decide = _decider(task, settings, bundle)
    believes = isinstance(settings, Guided | Descent | Shield) and settings.belief and task.belief
    return believing(decide, task.objectives) if believes else decide


def _decider(task: Task, settings: Settings, bundle: Bundle) -> MakeDecide:
    if isinstance(settings, Guided):
        guide = guide_for(task, settings, bundle)
        joint = partial(combine_teams, hierarchical_batch, task.robots) if settings.joint else None
        worth = _worth(settings, bundle) if settings.value_scale else None
        sample = sampled(partial(_field, bundle, settings), guide, joint, worth)
        return carrying(eased(sample, bundle.manifest, guide.ease_m), bundle.manifest)
    if isinstance(settings, Mean):
        return _mean(bundle)
    if isinstance(settings, Descent):
        descended = _post_processed(partial(descend, settings), _asked(task, settings), bundle)
        return carrying(eased(descended, bundle.manifest, settings.ease_m), bundle.manifest)
    if isinstance(settings, Shield):
        shielded = _post_processed(partial(shield, settings), _asked(task, settings), bundle)
        return eased(shielded, bundle.manifest, settings.ease_m)
    return _preferring(settings.preference, bundle)


def guide_for(task: Task, settings: Guided, bundle: Bundle) -> Guide:
    """The objectives of a guided flow, made ready."""
    objectives = tuple(
        replace(o, look_ahead=(settings.look_ahead or o.look_ahead) * settings.look_ahead_factor)
        for o in _asked(task, settings)
    )
    guide = make_guide(ObjectiveSet(objectives, settings.guidance), bundle.manifest.motion)
    if settings.corrected_as == "their own":
        return guide
    corrected = tuple(sorted(guide.preferences + guide.requirements))
    preferred = settings.corrected_as == "preferences"
    terms = tuple(term._replace(preference=preferred) for term in guide.steering.terms)
    return replace(
        guide,
        preferences=corrected if preferred else (),
        requirements=() if preferred else corrected,
        steering=guide.steering._replace(terms=terms),
    )


def _worth(settings: Guided, bundle: Bundle) -> Callable[[Observations], Worth]:
    """What actions are worth to a policy's task.

    Raises:
        ConfigError: if nobody has fitted it.
    """
    value = load_value(value_path(bundle), digest(bundle.directory))

    def worth(observation: Observations) -> Worth:
        slopes = value.slopes(observation)
        return Worth(lambda action: settings.value_scale * slopes(action), settings.value_first)

    return worth


class _Flat:
    """A velocity field whose Jacobian reads zero: gradients come from the terminal estimate as they are."""

    def __init__(self, field: VelocityField) -> None:
        self._field, self.observe, self.velocity = field, field.observe, field.velocity
        self.action_dim, self.schedule, self.sampler = field.action_dim, field.schedule, None

    def step(self, k: int, action: Floats) -> Array:
        velocity = self._field.step(k, action).copy()
        velocity[1:] = 0.0
        return velocity


def _field(bundle: Bundle, settings: Guided, batch: int) -> VelocityField | _Flat:
    weights, manifest = bundle.weights, bundle.manifest
    field = make_policy(weights, manifest.steps, batch, manifest.sampler) if weights else bundle.policy(batch)
    return field if settings.jacobian else _Flat(field)


def combine_teams(
    combine: BatchCombine, robots: int, gradients: Floats, factors: Floats, nominal: Floats
) -> Floats:
    """Eqs. 14 and 15 over a team's joint action, as the paper writes them, instead of robot by robot.

    A robot may then oppose its own flow, or another of its objectives, if the rest of the team outweighs
    it. It takes everybody's gradients at one place, which robots that decide on their own do not have: for
    comparison only.

    Args:
        combine: the projection.
        robots: N; a team's stand in consecutive rows.
        gradients: (M, E N, d)
        factors: (M,)
        nominal: (E N, d)

    Returns:
        (E N, d)
    """
    count, rows, size = gradients.shape
    teams = (rows // robots, robots * size)
    joint = combine(gradients.reshape(count, *teams), factors, nominal.reshape(teams))
    return joint.reshape(rows, size)


def _asked(task: Task, settings: Guided | Descent | Shield) -> tuple[Objective, ...]:
    parted = not isinstance(settings, Shield) and settings.deconfliction
    return task.objectives + task.deconfliction * parted + task.belief * settings.belief


def _mean(bundle: Bundle) -> MakeDecide:
    """A Gaussian policy as robots run it: a flow of one step that starts at zero."""
    alone = ObjectiveSet((), GuidanceSettings(start_noise=0.0))
    return sampled(bundle.policy, make_guide(alone, bundle.manifest.motion))


def _post_processed(adapt: Adapt, objectives: tuple[Objective, ...], bundle: Bundle) -> MakeDecide:
    """A Gaussian policy whose mean action is adapted afterwards."""
    asked = ObjectiveSet(objectives, GuidanceSettings(mode="none", scale=1.0))
    guide, predict = make_guide(asked, bundle.manifest.motion), _mean(bundle)

    def prepare(batch: int) -> Decide:
        mean = predict(batch)

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            outlooks = [look_ahead_batch(views, preview) for preview in guide.previews]
            return adapt(mean(observation, views, draw), guide, outlooks)

        return decide

    return prepare


def _preferring(preference: tuple[float, ...], bundle: Bundle) -> MakeDecide:
    """A Gaussian policy that observes a preference for each objective, the nominal one first."""
    predict = _mean(bundle)

    def prepare(batch: int) -> Decide:
        mean, column = predict(batch), np.tile(np.array(preference, np.float32), (batch, 1))

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            return mean(np.concatenate([observation, column], 1), views, draw)

        return decide

    return prepare
