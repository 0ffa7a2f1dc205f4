"""What the timeline's faults make of a team's packets and streams. Seeded."""

import random
from collections.abc import Iterator
from typing import Final

from firmware_bridge.sil.scenario.faults import (
    AnyFault,
    Blackout,
    CorruptPackets,
    Delay,
    Duplicate,
    Loss,
    NetworkFault,
    Reorder,
    SharedFault,
)

RETRANSMISSION_S: Final = 0.2
"""After so long Linux sends a lost piece of a TCP stream again, at the earliest."""


class Disturbance:
    """What the faults make of packets.

    Args:
        faults: those that are not of the network are passed over.
        seed: of the draws.
    """

    def __init__(self, faults: tuple[AnyFault, ...], seed: int) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, NetworkFault)]
        self._draw = random.Random(seed)

    def deliveries(
        self, packet: bytes, sender: int, receiver: int, elapsed_s: float
    ) -> Iterator[tuple[float, bytes]]:
        """Yield (delay in s, packet) of each copy that arrives."""
        copies = [(0.0, packet)]
        for fault in self._faults:
            if fault.at_s <= elapsed_s < fault.end_s and self._concerns(fault, sender, receiver):
                copies = [changed for copy in copies for changed in self._change(fault, *copy)]
        yield from copies

    def stream_delay_s(self, sender: int, receiver: int, elapsed_s: float) -> float:
        """Return how late a piece of a TCP stream arrives: what is lost or held up comes again or later."""
        delay_s = 0.0
        for fault in self._faults:
            if fault.at_s <= elapsed_s < fault.end_s and self._concerns(fault, sender, receiver):
                match fault:
                    case Blackout():
                        delay_s = max(delay_s, fault.end_s - elapsed_s)
                    case Delay():
                        delay_s += 1e-3 * fault.delay_ms
                    case Loss() if self._draw.random() < fault.share:
                        delay_s = max(delay_s, RETRANSMISSION_S)
        return delay_s

    def _concerns(self, fault: NetworkFault, sender: int, receiver: int) -> bool:
        return fault.robots is None or sender in fault.robots or receiver in fault.robots

    def _change(self, fault: NetworkFault, delay_s: float, packet: bytes) -> list[tuple[float, bytes]]:
        chance = self._draw.random()
        match fault:
            case Blackout():
                return []
            case Delay():
                return [(delay_s + 1e-3 * (fault.delay_ms + fault.jitter_ms * chance), packet)]
            case SharedFault() if chance < fault.share:
                return self._strike(fault, delay_s, packet)
        return [(delay_s, packet)]

    def _strike(self, fault: SharedFault, delay_s: float, packet: bytes) -> list[tuple[float, bytes]]:
        match fault:
            case Duplicate():
                return [(delay_s, packet)] * 2
            case Reorder():
                return [(delay_s + 1e-3 * fault.hold_ms, packet)]
            case CorruptPackets():
                return [(delay_s, self._changed(packet))]
        return []  # lost

    def _changed(self, packet: bytes) -> bytes:
        changed = bytearray(packet)
        changed[self._draw.randrange(len(changed))] ^= 1 << self._draw.randrange(8)
        return bytes(changed)
