"""How the tick grows with its sizes beside the paper's O(T (M K + M^2)); an estimate for Jetson Orin Nano."""

from collections.abc import Sequence

import msgspec
import numpy as np

from benchmarks.latency.cases import DEFAULT, Case
from benchmarks.latency.limit import operations, weight_bytes
from benchmarks.latency.rows import LatencyRow
from benchmarks.latency.sweeps import Sweep

ORIN_NANO_FLOPS = 1.5e9 * 2 * 4 * 2
"""One Cortex-A78AE at 1.5 GHz: two pipes of four fused multiply-adds a cycle."""
ORIN_NANO_CACHE_BYTES_S = 12e9
"""Assumed: its weights do not fit the core's 256 KiB L2 and are read from the shared L3 in every step."""
ORIN_NANO_SLOWDOWN = 3.5
"""Assumed for the interpreter's share: lower clock and narrower core than the machine measured on."""


class Growth(msgspec.Struct, frozen=True):
    """One backend along one sweep."""

    sweep: Sweep
    backend: str
    microseconds: tuple[float, ...]
    """Best round at every value."""

    @property
    def per_unit_us(self) -> float:
        """What one more costs: the slope of the straight line through all values."""
        return float(np.polyfit(self.sweep.values, self.microseconds, 1)[0])

    @property
    def exponent(self) -> float:
        """Of the power law through all values but zero."""
        pairs = [(x, us) for x, us in zip(self.sweep.values, self.microseconds, strict=True) if x > 0]
        return float(np.polyfit(*np.log(pairs).T, 1)[0])


def paper_terms(case: Case) -> int:
    """T (M K + M^2), the paper's count of cost terms and projections."""
    return case.euler_steps * case.objectives * (case.neighbours + case.objectives)


def grow(sweep: Sweep, rows: Sequence[LatencyRow], backends: Sequence[str]) -> list[Growth]:
    """Pick a sweep's rows; they hold every value of it."""
    found = {(row.backend, row.layers, row.T, row.M, row.K, row.batch): row.best_us for row in rows}

    def best_us(backend: str, case: Case) -> float:
        return found[backend, case.layers, case.euler_steps, case.objectives, case.neighbours, case.batch]

    return [
        Growth(sweep, backend, tuple(best_us(backend, sweep.make(value)) for value in sweep.values))
        for backend in backends
    ]


class Estimate(msgspec.Struct, frozen=True):
    """One tick of the default case on one core of a Jetson Orin Nano, in microseconds."""

    limit_us: float
    compiled_us: float
    numpy_us: float
    eager_us: float


def estimate_orin_nano(rows: Sequence[LatencyRow]) -> Estimate:
    """Scale the default case's rows by the assumptions above."""
    best = {row.backend: row.best_us for row in rows}
    compute = 1e6 * operations(DEFAULT) / ORIN_NANO_FLOPS
    limit = max(compute, 1e6 * weight_bytes(DEFAULT) / ORIN_NANO_CACHE_BYTES_S)
    compiled = limit * best["compiled"] / best["limit"]
    interpreted = ORIN_NANO_SLOWDOWN * (best["numpy"] - best["compiled"])
    return Estimate(limit, compiled, compiled + interpreted, ORIN_NANO_SLOWDOWN * best["eager"])
