"""What firmware hangs on: a python-can bus, a UDP socket of this machine."""

import contextlib
from collections.abc import Iterator
from typing import Final, Protocol, TypeVar

import can

from edge_runtime.config.network import Endpoint
from edge_runtime.network.arrival_time import clocks_together
from edge_runtime.network.datagrams import listen
from firmware_bridge.can.bus import bus_arguments
from firmware_bridge.can.frame import Frame
from firmware_bridge.sil.scenario.ports import HOST, TAKEN

LONGEST_QUEUE_S: Final = 1.0
"""No packet waits longer to be read."""
_DATAGRAM_BYTES: Final = 2048

Packet = TypeVar("Packet")


class Wire(Protocol[Packet]):
    """Moves packets; nothing blocks."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when packets have arrived."""
        ...

    def receive(self) -> Iterator[tuple[Packet, float]]:
        """Yield each packet with the monotonic time at which it was taken off the wire."""
        ...

    def send(self, packet: Packet) -> None:
        """Hand over a packet; one that nobody can take is lost."""
        ...

    def close(self) -> None:
        """Let go."""
        ...


class CanWire:
    """A CAN bus, by its address as ``edge-run --bus`` takes it."""

    def __init__(self, address: str) -> None:
        self._bus = can.Bus(ignore_config=True, **bus_arguments(address))  # type: ignore[arg-type]

    def fileno(self) -> int:
        """Return the bus's descriptor."""
        return self._bus.fileno()

    def receive(self) -> Iterator[tuple[Frame, float]]:
        """Yield the data frames that have arrived."""
        while (message := self._bus.recv(timeout=0)) is not None:
            if not message.is_error_frame:
                frame = Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)
                yield frame, to_monotonic(message.timestamp)

    def send(self, packet: Frame) -> None:
        """Send one frame; a full queue drops it, the next one comes soon."""
        message = can.Message(
            arbitration_id=packet.frame_id, data=packet.data, is_extended_id=packet.extended
        )
        self.send_raw(message)

    def send_raw(self, message: can.Message) -> None:
        """Send what is no data frame, such as the error frames by which a kernel tells of the bus."""
        with contextlib.suppress(can.CanOperationError):
            self._bus.send(message)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


class UdpWire:
    """A port of this machine, 0 for any that is free; answers whoever spoke last."""

    def __init__(self, port: int = 0) -> None:
        self._datagrams = listen((HOST, port), _DATAGRAM_BYTES, TAKEN)
        self._companion: Endpoint | None = None
        self.port = self._datagrams.place[1]

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._datagrams.fileno()

    def receive(self) -> Iterator[tuple[bytes, float]]:
        """Yield the datagrams that have arrived."""
        for datagram in self._datagrams.receive():
            self._companion = datagram.source
            yield datagram.content, datagram.arrival_s

    def send(self, packet: bytes) -> None:
        """Send to the companion; one that was killed refuses it, and the firmware does not mind."""
        if self._companion is not None:
            self._datagrams.send(packet, self._companion)

    def close(self) -> None:
        """Close the socket."""
        self._datagrams.close()


def to_monotonic(stamp_s: float) -> float:
    """Turn a kernel's stamp of arrival, which is of the wall clock, into monotonic time.

    A stamp from before the wall clock was set means nothing: then the packet counts as arriving now.
    """
    now_s, wall_s = clocks_together()
    waited_s = wall_s - stamp_s
    return now_s - waited_s if 0.0 <= waited_s < LONGEST_QUEUE_S else now_s
