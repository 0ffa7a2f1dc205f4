"""The logger's end of the loop's socket: what was sent is taken soon, whatever the disk does meanwhile."""

import contextlib
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Final

from edge_runtime.recording.wire import PACKET_BYTES

LOOK_S: Final = 0.05
"""Time between two looks: packets that woke this process, one by one, would cost the loop more to send. The
socket holds what a loop of 1000 Hz sends by then."""
MOST_BYTES: Final = 1 << 23
"""What may wait for a disk here; more stays in the socket, and once that is full the loop counts the rest."""


class Inbox:
    """Collects packets in a thread of its own, until the loop's end of the connection closes."""

    def __init__(self, connection: socket.socket) -> None:
        self.over = threading.Event()
        """The loop's end is closed, and all that it sent has been collected."""
        self._connection = connection
        self._connection.setblocking(False)
        self._packets: deque[bytes] = deque()
        self._collected = self._taken = 0  # bytes; each is changed by one thread alone
        threading.Thread(target=self._collect, name="inbox", daemon=True).start()

    def drain(self) -> Iterator[bytes]:
        """Yield what has been collected since the last time."""
        for _ in range(len(self._packets)):
            packet = self._packets.popleft()
            self._taken += len(packet)
            yield packet

    def _collect(self) -> None:
        buffer = memoryview(bytearray(PACKET_BYTES))
        while not self.over.is_set():
            with contextlib.suppress(BlockingIOError):
                self._empty_socket(buffer)
            time.sleep(LOOK_S)

    def _empty_socket(self, buffer: memoryview) -> None:
        """Take packets while there are any; raises BlockingIOError when none are left."""
        while self._collected - self._taken < MOST_BYTES and not self.over.is_set():
            try:
                size = self._connection.recv_into(buffer)
            except ConnectionResetError:
                continue  # the loop left without reading our report; what it sent is still there
            if size:
                self._packets.append(bytes(buffer[:size]))
                self._collected += size
            else:
                self.over.set()
