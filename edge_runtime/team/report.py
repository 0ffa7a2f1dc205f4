"""What became of the team's frames: counts by cause, and the ages that the policy worked with."""

from collections import Counter
from collections.abc import Mapping

import msgspec
import numpy as np

from edge_runtime.control.rate import Percentiles


class FleetReport(msgspec.Struct, frozen=True):
    """One robot's side of the team's traffic."""

    sent: int
    accepted: int
    refused: dict[str, int]
    """Received frames that were dropped, by cause; see `edge_runtime.network.team_wire.Refusal`."""
    failures: dict[str, int]
    """What the network did not take or give, by the system's name of the cause."""
    message_age_ms: Percentiles | None
    """Ages of the accepted frames when they were taken; None before the first."""
    used_age_ms: Percentiles | None
    """Ages of the states given to the policy, tick by tick: lost frames show here."""
    masked: dict[int, int]
    """Ticks in which a neighbour was too old for the policy, by its id."""
    objectives_version: dict[int, int]
    """The newest that each robot said it follows."""
    own_objectives_version: int
    """What this robot follows: 0 is what it was started with."""
    disagreed: dict[int, int]
    """Ticks in which a neighbour followed other objectives, by its id."""
    doubted: dict[int, int]
    """Frames made with the key that nobody in order sends, by their robot's id; it was kept out."""


class Ages:
    """Collects ages in a ring allocated beforehand.

    Args:
        capacity: ages that the percentiles look back on; the maximum is that of the whole run.
    """

    def __init__(self, capacity: int = 65536) -> None:
        self._ring_ms = np.zeros(capacity, np.float32)
        self._ring_ms.fill(0.0)  # touch every page now, not in the loop
        self._count, self._max_ms = 0, 0.0

    def add(self, age_s: float) -> None:
        """Take in one age."""
        age_ms = 1e3 * age_s
        self._ring_ms[self._count % len(self._ring_ms)] = age_ms
        self._max_ms = max(self._max_ms, age_ms)
        self._count += 1

    def percentiles_ms(self) -> Percentiles | None:
        """Return their distribution, or None where there are none."""
        if not self._count:
            return None
        p50, p99, p99_9 = np.percentile(self._ring_ms[: self._count], [50.0, 99.0, 99.9]).tolist()
        return Percentiles(p50, p99, p99_9, self._max_ms)


class Traffic:
    """Keeps count of one robot's frames."""

    def __init__(self) -> None:
        self.sent = 0
        self.accepted = 0
        self.refused: Counter[str] = Counter()
        self.masked: Counter[int] = Counter()
        self.disagreed: Counter[int] = Counter()
        self.doubted: Counter[int] = Counter()
        self.message_ages = Ages()
        self.used_ages = Ages()

    def report(
        self, failures: Counter[str], objectives_version: Mapping[int, int], own_version: int
    ) -> FleetReport:
        """Sum up."""
        return FleetReport(
            self.sent,
            self.accepted,
            dict(self.refused),
            dict(failures),
            self.message_ages.percentiles_ms(),
            self.used_ages.percentiles_ms(),
            dict(self.masked),
            dict(objectives_version),
            own_version,
            dict(self.disagreed),
            dict(self.doubted),
        )
