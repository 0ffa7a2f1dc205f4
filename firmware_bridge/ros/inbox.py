"""From a client library's threads to the guard's one thread: a bounded queue, and a socket that rings."""

import contextlib
import socket
from collections import deque
from typing import Final, Generic, TypeVar

from edge_runtime.errors import BridgeError

MOST: Final = 256
"""Items that may wait: five seconds of odometry at 50 Hz. Whoever cannot keep up with that guards nothing."""
_RINGS: Final = 4096

T = TypeVar("T")


class Inbox(Generic[T]):
    """Threads put items in and ring; the guard takes them out. Its descriptor is readable while one waits."""

    def __init__(self) -> None:
        self._items: deque[T] = deque()
        self._bell, self._ringing = socket.socketpair()
        self._bell.setblocking(False)
        self._ringing.setblocking(False)

    def fileno(self) -> int:
        """What becomes readable."""
        return self._bell.fileno()

    def put(self, item: T) -> None:
        """Add an item, from any thread; beyond one more than `MOST` it is left out, and `take` says so."""
        if len(self._items) <= MOST:
            self._items.append(item)
        with contextlib.suppress(OSError):  # rings already, or is closed
            self._ringing.send(b"\0")

    def take(self) -> list[T]:
        """Return what has arrived, in order.

        Raises:
            BridgeError: if more arrived than could be taken.
        """
        with contextlib.suppress(BlockingIOError):
            self._bell.recv(_RINGS)
        taken = [self._items.popleft() for _ in range(len(self._items))]
        if len(taken) > MOST:
            raise BridgeError(f"over {MOST} messages came at once: something floods a topic of the robot")
        return taken

    def close(self) -> None:
        """Close both ends; what is put in afterwards is lost."""
        self._bell.close()
        self._ringing.close()
