"""What the watcher has heard: each robot's newest status, and when it came."""

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from edge_runtime.common.printable import printed
from edge_runtime.network.seal import FrameError
from edge_runtime.telemetry.status import Status, decode
from edge_runtime.tools.watch.feed import Feed

SILENT_S: Final = 1.0
"""A robot is silent when its newest status is older: five in a row were lost, or it is gone."""


class Heard(msgspec.Struct, frozen=True):
    """A robot's newest status, and when it arrived."""

    status: Status
    arrival_s: float
    """Monotonic, by the watcher's clock."""
    clock_ahead_s: float
    """The robot's wall clock minus the watcher's, on arrival: a recording of last week shows here."""


class WatchedTeam:
    """Takes in packets and keeps what is newest.

    A robot's statuses are ordered by when it started and their sequence; older ones are dropped, so that
    nobody can put a recording over a robot that talks.

    Args:
        robot_ids: of the fleet.
        key: the team's.
        clock: monotonic time in seconds.
        wall_clock: seconds since 1970.
    """

    def __init__(
        self,
        robot_ids: Iterable[int],
        key: bytes,
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self.heard: dict[int, Heard | None] = dict.fromkeys(robot_ids)
        """In the fleet's order; None for a robot not heard yet."""
        self.dropped: Counter[str] = Counter()
        """Packets that were not taken in, by cause."""
        self._key, self._clock, self._wall_clock = key, clock, wall_clock

    def receive(self, feed: Feed) -> None:
        """Take in what has arrived."""
        for packet in feed.receive():
            self.hear(packet)

    def hear(self, packet: bytes) -> None:
        """Take in one packet, or count why not."""
        try:
            status = printed(decode(packet, self._key))
        except FrameError as error:
            self.dropped[str(error)] += 1
            return
        if status.robot_id not in self.heard:
            self.dropped["unknown robot"] += 1
            return
        before = self.heard[status.robot_id]
        if before is not None and _order(status) <= _order(before.status):
            self.dropped["not newer"] += 1
            return
        ahead_s = status.sent_s - self._wall_clock()
        self.heard[status.robot_id] = Heard(status, self._clock(), ahead_s)

    def age_s(self, heard: Heard) -> float:
        """Return how long ago a status arrived."""
        return self._clock() - heard.arrival_s

    def silent(self, robot_id: int) -> bool:
        """Whether a robot was not heard lately, or ever."""
        heard = self.heard[robot_id]
        return heard is None or self.age_s(heard) > SILENT_S

    @property
    def all_heard(self) -> bool:
        """Whether every robot talks."""
        return not any(map(self.silent, self.heard))


def _order(status: Status) -> tuple[float, int]:
    return status.started_s, status.sequence
