"""What longer actions cost: the same tick for robots of two, three and four action components."""

from collections.abc import Iterator

import numpy as np

from benchmarks.latency.cases import MODELS, Case, workload
from benchmarks.latency.contenders import CONTENDERS
from benchmarks.latency.measure import Timing, interleave, stolen_share

NAMES = ("compiled", "compiled-own", "numpy")


def measure(rounds: int = 40, slot_s: float = 0.05) -> dict[str, Timing]:
    """Time each contender for each size in one interleaved run."""
    return interleave(
        {
            _key(name, size): CONTENDERS[name](workload(Case(action_dim=size)))
            for name in NAMES
            for size in MODELS
        },
        rounds,
        slot_s,
    )


def lines(timings: dict[str, Timing]) -> Iterator[str]:
    """A line for each contender and size, with its time over that of two components in the same round."""
    yield f"other processes took {stolen_share(timings):.0%} of the time; ratios are of processor time"
    for name in NAMES:
        planar = timings[_key(name, 2)]
        for size, model in MODELS.items():
            timing = timings[_key(name, size)]
            ratio = np.reciprocal(timing.times_faster_than(planar))
            where = "in space" if model.dims == 3 else "in the plane"
            yield (
                f"{name}, d = {size}, {model.kind} {where}: {timing.best_us:.1f} us at best, "
                f"{ratio:.2f} times d = 2"
            )


def _key(name: str, size: int) -> str:
    return f"{name} {size}"
