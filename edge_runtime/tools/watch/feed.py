"""Where a watcher's packets come from: the robots, or the watcher that holds the address already.

Robots send to one address, which one process can hold. A second edge-watch there, a script's ``--once``
beside somebody's screen, asks the first one, which passes on what it hears; it asks again each second, and
takes over the address once the first one is gone.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Final

from edge_runtime.common.closing import Closing
from edge_runtime.config.network import Endpoint
from edge_runtime.errors import AddressTakenError
from edge_runtime.network.datagrams import Datagram, call, listen
from edge_runtime.network.seal import FrameError, Magic, seal, unseal
from edge_runtime.telemetry.status import LONGEST

ASK_S: Final = 1.0
FORGET_S: Final = 3.5
"""Whoever has not asked for so long is passed nothing any more."""
MOST_LISTENERS: Final = 8
QUESTION: Final = "is this the machine that [watch] names?"


class Feed(Closing):
    """Packets of statuses, as they were sent; not read yet.

    Args:
        place: where the robots send to.
        key: the team's.
        clock: monotonic time in seconds.

    Raises:
        ConfigError: if this machine does not have the address.
    """

    def __init__(self, place: Endpoint, key: bytes, clock: Callable[[], float] = time.monotonic) -> None:
        self._place, self._key, self._clock = place, key, clock
        self._listeners: dict[Endpoint, float] = {}
        self._asked_s = clock()
        self.first_hand = True
        """Whether the robots' own packets arrive here."""
        try:
            self._datagrams = listen(place, LONGEST, QUESTION)
        except AddressTakenError:
            self._datagrams, self.first_hand = call(place, LONGEST), False
            self._ask()

    def close(self) -> None:
        """Give the address back."""
        self._datagrams.close()

    def wait(self, seconds: float) -> None:
        """Wait for packets for at most so long."""
        self._datagrams.wait(seconds)

    def receive(self) -> Iterator[bytes]:
        """Take what has arrived, and pass it on to whoever asks for it."""
        now_s = self._clock()
        if not self.first_hand and now_s >= self._asked_s + ASK_S:
            self._take_over()
        self._listeners = {each: asked for each, asked in self._listeners.items() if now_s - asked < FORGET_S}
        for datagram in self._datagrams.receive():
            if datagram.content.startswith(Magic.LISTEN):
                self._admit(datagram)
                continue
            for listener in self._listeners:
                self._datagrams.send(datagram.content, listener)
            yield datagram.content

    def _admit(self, datagram: Datagram) -> None:
        """Take note of a watcher on this machine; nobody elsewhere is sent anything on a packet's word."""
        with contextlib.suppress(FrameError):
            unseal(datagram.content, Magic.LISTEN, self._key, 0)
            known = datagram.source in self._listeners or len(self._listeners) < MOST_LISTENERS
            if known and datagram.source[0] == self._datagrams.place[0]:
                self._listeners[datagram.source] = self._clock()

    def _take_over(self) -> None:
        """Hold the address from here on if nobody does, else ask again."""
        with contextlib.suppress(AddressTakenError):
            own = listen(self._place, LONGEST, QUESTION)
            self._datagrams.close()
            self._datagrams, self.first_hand = own, True
            return
        self._ask()

    def _ask(self) -> None:
        self._asked_s = self._clock()
        self._datagrams.send(seal(Magic.LISTEN, b"", self._key), self._place)
