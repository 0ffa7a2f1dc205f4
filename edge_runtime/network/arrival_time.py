"""When a datagram arrived, by the kernel's stamp: a receiver that comes late does not make messages young.

Linux stamps by the wall clock (SO_TIMESTAMPNS), which may be set at any moment, while everything here goes
by the monotonic clock. So the distance between the two is read at the start of every drain. If it moved
since the last one, the wall clock was set while packets may have waited, and their stamps mean nothing:
until the queue has been empty once, packets count as arriving when they are taken.
"""

import socket
import struct
import sys
import time
from collections.abc import Callable, Sequence
from typing import Final

_SO_TIMESTAMPNS: Final = 35
"""Of Linux on x86 and ARM; Python does not name it."""
_STAMP: Final = struct.Struct("@ll")
ANCILLARY_BYTES: Final = socket.CMSG_SPACE(_STAMP.size)
"""Room for one stamp beside a datagram."""
STEADY_S: Final = 1e-3
"""Greatest change of the clocks' distance between two drains: slewing takes 0.5 ms in a second."""

TOGETHER_S: Final = 1e-4
"""Two clocks that are read within so much count as read at one moment."""

Ancillary = Sequence[tuple[int, int, bytes]]


def clocks_together(
    clock: Callable[[], float] = time.monotonic, wall: Callable[[], float] = time.time
) -> tuple[float, float]:
    """Read the monotonic and the wall clock at one moment: who is held up between them reads them again."""
    while True:
        now_s, wall_s = clock(), wall()
        if clock() - now_s <= TOGETHER_S:
            return now_s, wall_s


class ArrivalClock:
    """Tells arrivals in monotonic time.

    Args:
        receiver: the socket that is to stamp what it receives.
        clock: monotonic time in seconds.
        wall: the wall clock.
    """

    def __init__(
        self,
        receiver: socket.socket,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self._clock, self._wall = clock, wall
        self._now_s, wall_s = clocks_together(clock, wall)
        self._distance_s = self._now_s - wall_s
        self._trusted = False
        if sys.platform == "linux":
            receiver.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)

    def begin(self) -> None:
        """Start a drain."""
        self._now_s, wall_s = clocks_together(self._clock, self._wall)
        distance_s = self._now_s - wall_s
        if abs(distance_s - self._distance_s) > STEADY_S:
            self._trusted = False
        self._distance_s = distance_s

    def emptied(self) -> None:
        """Note that nothing waits any more: what comes next is stamped by the clock as it is now."""
        self._trusted = True

    def arrival_s(self, ancillary: Ancillary) -> float:
        """Return when a datagram of this drain arrived; without a usable stamp, when the drain began."""
        if self._trusted:
            for level, kind, content in ancillary:
                if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(content) == _STAMP.size:
                    seconds, nanoseconds = _STAMP.unpack(content)
                    return self._distance_s + seconds + 1e-9 * nanoseconds
        return self._now_s
