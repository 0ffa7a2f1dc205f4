"""Robots that keep a belief of the field that they sample, and know where most of it is left."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.objectives import Geofence, Objective
from export.beliefs.sample_belief import SampleBelief
from export.episodes.play import Decide, MakeDecide, Observations
from export.evaluation.outlook import MotionBatch, TeamBatch

RICHEST = "richest"
"""What objectives call the place."""


def believing(make_decide: MakeDecide, objectives: Sequence[Objective]) -> MakeDecide:
    """Decide with the place that each robot believes the richest among what it tracks.

    Args:
        make_decide: who decides, by observations that end in the eight readings of Sampling.
        objectives: what is asked of them: where they may not go, nothing is to be gathered.
    """
    closed = [(*zone.centre_m[:2], zone.radius_m) for zone in objectives if isinstance(zone, Geofence)]

    def prepare(batch: int) -> Decide:
        decide, belief = make_decide(batch), SampleBelief(batch, closed)

        def decide_believing(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            there = belief.follow(views.own.position_m, views.mates.position_m, seen[:, -8:])
            richest = MotionBatch.of(there, np.zeros_like(there))
            return decide(seen, replace(views, tracked={**views.tracked, RICHEST: richest}), draw)

        return decide_believing

    return prepare
