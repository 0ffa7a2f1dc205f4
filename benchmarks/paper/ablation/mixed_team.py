"""Guidance in a team of robots of different masses: each previews its motion by its own dynamics."""

from collections.abc import Sequence

import msgspec
import numpy as np

from benchmarks.paper.ablation.views import rows_of
from benchmarks.paper.episodes import Decide, MakeDecide
from benchmarks.paper.methods import Observations
from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.objectives import Objective
from edge_runtime.policy.bundle import Bundle
from export.evaluation.guidance import guided_actions
from export.evaluation.outlook import TeamBatch


def guided_by_own_mass(
    settings: GuidanceSettings, objectives: tuple[Objective, ...], masses_kg: Sequence[float], bundle: Bundle
) -> MakeDecide:
    """A guided flow, robot i of every team of N previewing with ``masses_kg[i]``.

    As in the runtime, a robot previews its teammates by its own dynamics too: frames tell intended actions,
    not masses.
    """
    kinds = sorted(set(masses_kg))
    dynamics = [msgspec.structs.replace(bundle.manifest.dynamics, mass_kg=mass) for mass in kinds]
    guides = [make_guide(ObjectiveSet(objectives, settings), own) for own in dynamics]

    def prepare(batch: int) -> Decide:
        mass = np.resize(masses_kg, batch)
        members = [np.flatnonzero(mass == kind) for kind in kinds]
        policies = [bundle.policy(len(rows)) for rows in members]

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            start = settings.start_noise * draw.standard_normal((batch, 2))
            action = np.empty((batch, 2))
            for guide, rows, policy in zip(guides, members, policies, strict=True):
                own = rows_of(views, rows)
                action[rows] = guided_actions(policy, observation[rows], own, guide, start[rows])
            return action

        return decide

    return prepare
