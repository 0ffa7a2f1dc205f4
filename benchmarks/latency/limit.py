"""The least time in which one core of this processor could compute the tick's network.

The tick's floating-point operations over the core's measured peak (a large BLAS product), or its weights over
the measured rate at which they can be read again and again, whichever takes longer.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from benchmarks.latency.cases import Case
from benchmarks.latency.measure import Slot, Timing

PEAK_SIZE = 256
PROBES = ("peak", "traffic")


def operations(case: Case) -> int:
    """Multiplications and additions of one tick: what no implementation of forward mode can leave out.

    Mode ``correction`` needs no Jacobian.
    """
    first, last, d = case.layers[0], case.layers[-1], case.action_dim
    rows = 1 if case.mode == "correction" else 1 + d
    inner = sum(a * b for a, b in pairwise(case.layers))
    per_step = 2 * (d * first + rows * inner + rows * last * d)
    return case.batch * (2 * case.observation_dim * first + case.steps * per_step)


def weight_bytes(case: Case) -> int:
    """Weights that one tick reads, in bytes; a batch shares them."""
    inner = sum(a * b for a, b in pairwise(case.layers))
    ends = case.layers[0] * case.action_dim + case.layers[-1] * case.action_dim
    return 4 * (case.observation_dim * case.layers[0] + case.steps * (inner + ends))


def probes(case: Case) -> dict[str, Callable[[], object]]:
    """The two measurements behind the limit, to be interleaved with the contenders."""
    square = np.random.default_rng(0).standard_normal((PEAK_SIZE, PEAK_SIZE)).astype(np.float32)
    product = np.empty_like(square)
    columns = case.layers[0]
    rows = max(1, weight_bytes(case) // case.steps // (4 * columns))
    weights = np.ones((rows, columns), np.float32)
    vector, result = np.ones(columns, np.float32), np.empty(rows, np.float32)
    return {"peak": lambda: square.dot(square, product), "traffic": lambda: weights.dot(vector, result)}


def limit(case: Case, peak: Timing, traffic: Timing) -> Timing:
    """The limit in each round, from the probes' best tick in it."""
    slots = []
    for product, reading in zip(peak.slots, traffic.slots, strict=True):
        compute = product.cpu.min() * operations(case) / (2 * PEAK_SIZE**3)
        least = np.array([max(compute, reading.cpu.min() * case.steps)])
        slots.append(Slot(least, least))
    return Timing(tuple(slots))
