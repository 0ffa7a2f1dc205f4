"""`edge_runtime.observation.View.ranges` for B robots: teammates seen farther away than they are."""

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.observation import Proximity, Ranges
from edge_runtime.observation.observer import Observed
from export.episodes.play import Decide, MakeDecide, Observations
from export.evaluation.outlook import TeamBatch


def eased(make_decide: MakeDecide, observed: Observed, ease_m: float) -> MakeDecide:
    """Decide from ranges that are ``ease_m`` longer, up to the sensor's.

    Args:
        make_decide: who decides.
        observed: tells the fields of its observations.
        ease_m: in the policy's metres.
    """
    if not ease_m:
        return make_decide
    reach, start, spans = observed.body.lidar_range_m, 0, []
    for field in observed.observation:
        if isinstance(field, Ranges):
            spans.append((slice(start, start + field.size), isinstance(field, Proximity)))
        start += field.size

    def prepare(batch: int) -> Decide:
        decide = make_decide(batch)

        def decide_at_ease(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            longer = seen.copy()
            for span, from_reach in spans:
                if from_reach:
                    longer[:, span] = np.maximum(longer[:, span] - ease_m, 0.0)
                else:
                    longer[:, span] = np.minimum(longer[:, span] + ease_m, reach)
            return decide(longer, views, draw)

        return decide_at_ease

    return prepare
