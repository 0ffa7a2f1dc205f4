"""How the tick grows with its sizes beside the paper's O(T (M K + M^2))."""

from collections.abc import Sequence

import msgspec
import numpy as np

from benchmarks.latency.cases import Case
from benchmarks.latency.rows import LatencyRow
from benchmarks.latency.sweeps import Sweep


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
    return case.steps * case.objectives * (case.neighbours + case.objectives)


def grow(sweep: Sweep, rows: Sequence[LatencyRow], backends: Sequence[str]) -> list[Growth]:
    """Pick a sweep's rows; they hold every value of it."""
    found = {(row.backend, row.layers, row.T, row.M, row.K, row.batch): row.best_us for row in rows}

    def best_us(backend: str, case: Case) -> float:
        return found[backend, case.layers, case.steps, case.objectives, case.neighbours, case.batch]

    return [
        Growth(sweep, backend, tuple(best_us(backend, sweep.make(value)) for value in sweep.values))
        for backend in backends
    ]
