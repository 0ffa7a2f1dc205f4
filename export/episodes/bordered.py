"""`edge_runtime.observation.border.Border` for B robots: places beyond an arena observed on its border."""

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.observation.border import Arena, Border
from edge_runtime.observation.observer import Observed
from export.episodes.play import Decide, MakeDecide, Observations
from export.evaluation.outlook import TeamBatch


def bordered(make_decide: MakeDecide, observed: Observed, arena: Arena | None) -> MakeDecide:
    """Decide as if a robot beyond an arena stood on its border, all else that it observes as it is.

    Args:
        make_decide: who decides.
        observed: tells the fields of its observations.
        arena: the training's, in the policy's metres; without one all is observed as it is.
    """
    border = Border(observed.observation, arena)
    if not border.limits:
        return make_decide

    def prepare(batch: int) -> Decide:
        decide = make_decide(batch)

        def decide_inside(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            inside = seen.copy()
            border.clamp(inside)
            return decide(inside, views, draw)

        return decide_inside

    return prepare
