"""Robots that know how far what they carry is from its goal."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.observation import TrackedGoalOffset
from edge_runtime.observation.observer import Observed
from export.episodes.play import Decide, MakeDecide, Observations
from export.evaluation.outlook import TeamBatch


def carrying(make_decide: MakeDecide, observed: Observed) -> MakeDecide:
    """Decide with the distances that the observations tell, for `GuidanceSettings.goal_reach`.

    Args:
        make_decide: who decides.
        observed: tells the fields of its observations; without a tracked object's way to its goal among them
            nothing is known of any.
    """
    left_m = distance_left(observed)
    if left_m is None:
        return make_decide

    def prepare(batch: int) -> Decide:
        decide = make_decide(batch)

        def decide_carrying(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            return decide(seen, replace(views, left_m=left_m(seen)), draw)

        return decide_carrying

    return prepare


def distance_left(observed: Observed) -> Callable[[Observations], Floats] | None:
    """How far what is carried is from its goal, (B,), by observations (B, O); None where they do not tell."""
    start, spans = 0, list[slice]()
    for field in observed.observation:
        if isinstance(field, TrackedGoalOffset):
            spans.append(slice(start, start + field.size))
        start += field.size
    if not spans:
        return None
    return lambda seen: np.max([np.linalg.norm(seen[:, span], axis=1) for span in spans], 0)
