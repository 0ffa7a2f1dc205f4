"""The flow's steps where a policy takes them all at once, as the compiled kernel does."""

import time
from collections.abc import Sequence

from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.slopes import ObjectiveError, encoded, not_finite
from edge_runtime.messages import GuidedAction, Vector
from edge_runtime.motion.outlook import Outlook
from edge_runtime.policy.velocity_field import Sampler, Term


def native_flow(
    sampler: Sampler,
    outlooks: Sequence[Outlook],
    guide: Guide,
    start: Vector,
    deadline_s: float,
    total: int,
    most_steps: int,
) -> GuidedAction:
    """Sample an action that is still to be corrected; the observation is set already."""
    terms: list[Term] = []
    rest = (0.0,) * len(start)
    steering = zip(guide.kernel_terms, guide.kernel_heads, guide.objectives, outlooks, strict=True)
    for kind, head, objective, outlook in steering if guide.steers else ():
        try:
            numbers = encoded(objective, outlook)
        except ObjectiveError as error:
            return GuidedAction(rest, 0, fault=str(error), correction=rest, objective_failed=True)
        terms.append((kind, head, numbers))
    sample = sampler.sample(guide.projection, terms, start, deadline_s - time.monotonic(), most_steps)
    if sample.fault >= 0:
        fault = str(not_finite(guide.objectives[sample.fault]))
        return GuidedAction(sample.action, sample.steps, fault=fault, correction=rest, objective_failed=True)
    cut, nothing = sample.steps < total, (0,) * len(outlooks)
    return GuidedAction(
        sample.action,
        sample.steps,
        sample.costs or nothing,
        sample.projections,
        "",
        sample.conflicts or nothing,
        sample.opposed,
        correction=rest,
        cut=cut,
    )
