"""What became of the team's frames: counts by cause, and the ages that the policy worked with."""

from collections import Counter
from collections.abc import Iterable, Mapping

import msgspec
import numpy as np

from edge_runtime.rate import Percentiles


class FleetReport(msgspec.Struct, frozen=True):
    """One robot's side of the team's traffic."""

    sent: int
    accepted: int
    refused: dict[str, int]
    """Received frames that were dropped, by cause; see `edge_runtime.fleet_wire.Refusal`."""
    failures: dict[str, int]
    """What the network did not take or give, by the system's name of the cause."""
    age_ms: Percentiles | None
    """Ages of the states given to the policy; None before the first."""
    masked: dict[int, int]
    """Ticks in which a neighbour was too old for the policy, by its id."""
    objectives_version: dict[int, int]
    """The newest that each robot said it follows."""


class Traffic:
    """Keeps count of one robot's frames.

    Args:
        capacity: ages that the percentiles look back on; the maximum is that of the whole run.
    """

    def __init__(self, capacity: int = 65536) -> None:
        self.sent = 0
        self.accepted = 0
        self.refused: Counter[str] = Counter()
        self.masked: Counter[int] = Counter()
        self._ages_ms = np.zeros(capacity, np.float32)
        self._ages_ms.fill(0.0)  # touch every page now, not in the loop
        self._count, self._max_ms = 0, 0.0

    def used(self, ages_s: Iterable[float]) -> None:
        """Record the ages of the states that one tick works with."""
        for age_s in ages_s:
            self._ages_ms[self._count % len(self._ages_ms)] = 1e3 * age_s
            self._max_ms = max(self._max_ms, 1e3 * age_s)
            self._count += 1

    def report(self, failures: Counter[str], objectives_version: Mapping[int, int]) -> FleetReport:
        """Sum up."""
        return FleetReport(
            self.sent,
            self.accepted,
            dict(self.refused),
            dict(failures),
            self._percentiles(),
            dict(self.masked),
            dict(objectives_version),
        )

    def _percentiles(self) -> Percentiles | None:
        if not self._count:
            return None
        kept = self._ages_ms[: self._count]
        p50, p99, p99_9 = np.percentile(kept, [50.0, 99.0, 99.9]).tolist()
        return Percentiles(p50, p99, p99_9, self._max_ms)
