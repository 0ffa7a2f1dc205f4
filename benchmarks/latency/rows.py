"""The result of a run: one row for each contender and case, as written to and compared from JSON."""

from collections.abc import Mapping, Sequence

import msgspec

from benchmarks.latency.cases import Case
from benchmarks.latency.measure import Timing


class LatencyRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One contender on one case; durations are wall time."""

    backend: str
    layers: tuple[int, ...]
    observation_dim: int
    action_dim: int
    T: int
    M: int
    K: int
    batch: int
    paced_hz: float
    """0 for ticks back to back."""
    realtime: bool = False
    """SCHED_FIFO and locked memory; only in paced rows."""
    early_wake: bool = False
    """A throw-away tick before each; only in paced rows."""
    sampler: str = "euler"
    mode: str = "hierarchical"
    median_us: float
    best_us: float
    """Median of the best round."""
    p99_us: float
    p99_9_us: float
    ratio_to_eager: float | None
    """Ticks in one of eager autograd's of the same case and run; None where eager was not timed."""

    @property
    def key(self) -> tuple[object, ...]:
        """What two runs' rows are matched by."""
        sizes = (self.layers, self.observation_dim, self.action_dim, self.T, self.M, self.K, self.batch)
        sizes += (self.sampler, self.mode)
        return (self.backend, *sizes, self.paced_hz, self.realtime, self.early_wake)

    @property
    def loop(self) -> str:
        """Name of a paced row's loop."""
        ways = ", real-time" * self.realtime + ", early wake" * self.early_wake
        return f"{self.backend}, {self.paced_hz:g} Hz{ways}"


def make_row(
    backend: str, case: Case, timing: Timing, eager: Timing | None = None, **paced: object
) -> LatencyRow:
    """Summarize one contender's ticks."""
    return LatencyRow(
        backend=backend,
        layers=case.layers,
        observation_dim=case.observation_dim,
        action_dim=case.action_dim,
        T=case.steps,
        M=case.objectives,
        K=case.neighbours,
        batch=case.batch,
        sampler=case.sampler,
        mode=case.mode,
        median_us=timing.median_us,
        best_us=timing.best_us,
        p99_us=timing.percentile_us(99.0),
        p99_9_us=timing.percentile_us(99.9),
        ratio_to_eager=timing.times_faster_than(eager) if eager else None,
        **({"paced_hz": 0.0} | paced),
    )


def make_rows(case: Case, timings: Mapping[str, Timing]) -> list[LatencyRow]:
    """Rows of one interleaved run."""
    return [make_row(name, case, timing, timings.get("eager")) for name, timing in timings.items()]


def compare(old: Sequence[LatencyRow], new: Sequence[LatencyRow]) -> list[str]:
    """One line for each row that both runs have: how the best round's tick changed."""
    before = {row.key: row.best_us for row in old}
    return [
        f"{row.backend} {row.layers} {row.sampler} {row.mode} T={row.T} M={row.M} K={row.K} "
        f"batch={row.batch} {row.paced_hz:g} Hz: "
        f"{before[row.key]:.1f} -> {row.best_us:.1f} us ({row.best_us / before[row.key] - 1:+.1%})"
        for row in new
        if row.key in before
    ]
