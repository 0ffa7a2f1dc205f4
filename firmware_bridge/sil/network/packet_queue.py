"""What is under way in a network with faults, and when it arrives."""

import heapq
import time
from collections.abc import Callable
from typing import Final

from firmware_bridge.sil.network.disturbance import Disturbance

_IDLE_S: Final = 0.1
Send = Callable[[bytes], object]
"""Hands a packet to whom it is for; one that is refused is lost, as on any network."""


class PacketQueue:
    """Delivers packets, now or later.

    Args:
        disturbance: decides when, and how often.
    """

    def __init__(self, disturbance: Disturbance) -> None:
        self.t0_s = float("inf")
        """When the timeline of faults began."""
        self._disturbance = disturbance
        self._under_way: list[tuple[float, int, Send, bytes]] = []
        self._count = 0

    @property
    def wait_s(self) -> float:
        """How long until something is to be delivered; not for ever."""
        if not self._under_way:
            return _IDLE_S
        return min(max(self._under_way[0][0] - time.monotonic(), 0.0), _IDLE_S)

    def deliver(self, packet: bytes, sender: int, receiver: int, send: Send) -> None:
        """Take in a packet."""
        now_s = time.monotonic()
        for delay_s, copy in self._disturbance.deliveries(packet, sender, receiver, now_s - self.t0_s):
            if delay_s == 0.0:
                _send(send, copy)
            else:
                self._hold(now_s + delay_s, send, copy)

    def stream(self, piece: bytes, sender: int, receiver: int, send: Send, not_before_s: float) -> float:
        """Take in a piece of a TCP stream; returns when it arrives, before which the next one must not."""
        now_s = time.monotonic()
        late_s = self._disturbance.stream_delay_s(sender, receiver, now_s - self.t0_s)
        due_s = max(now_s + late_s, not_before_s)
        self._hold(due_s, send, piece)
        return due_s

    def flush(self) -> None:
        """Deliver what is due."""
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            _, _, send, packet = heapq.heappop(self._under_way)
            _send(send, packet)

    def _hold(self, due_s: float, send: Send, packet: bytes) -> None:
        self._count += 1  # packets due at the same time leave in the order of arrival
        heapq.heappush(self._under_way, (due_s, self._count, send, packet))


def _send(send: Send, packet: bytes) -> None:
    try:
        send(packet)
    except OSError:
        return  # a robot that is gone, or a full queue
