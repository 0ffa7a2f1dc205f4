"""Views of a team, rearranged: some of their rows, or without what teammates intend."""

from dataclasses import fields, replace

import numpy as np
import numpy.typing as npt

from benchmarks.paper.episodes import Decide, MakeDecide
from benchmarks.paper.methods import Observations, guided
from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import Objective
from edge_runtime.policy.bundle import Bundle
from export.evaluation.outlook import TeamBatch

Rows = npt.NDArray[np.int64]


def rows_of(views: TeamBatch, rows: Rows) -> TeamBatch:
    """Rows (R,) of B robots' views, each as often as it is named."""
    return TeamBatch(**{field.name: getattr(views, field.name)[rows] for field in fields(views)})


def uninformed(settings: GuidanceSettings, objectives: tuple[Objective, ...], bundle: Bundle) -> MakeDecide:
    """A guided flow whose robots take their teammates' intended actions as zero."""
    make = guided(settings, objectives, bundle)

    def prepare(batch: int) -> Decide:
        informed = make(batch)

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            silent = replace(views, mate_action=np.zeros_like(views.mate_action))
            return informed(observation, silent, draw)

        return decide

    return prepare
