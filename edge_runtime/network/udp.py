"""Frames over UDP unicast: nothing waits, nothing raises, what fails is counted."""

import errno
import socket
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple, Protocol

from edge_runtime.config.network import Endpoint
from edge_runtime.errors import ConfigError
from edge_runtime.network.arrival_time import ANCILLARY_BYTES, ArrivalClock
from edge_runtime.network.order_wire import PACKET_BYTES

DRAIN: Final = 256
"""Most packets taken in one tick, about what the kernel queues: a flood costs a bounded time."""


class Datagram(NamedTuple):
    """A packet as it was received."""

    content: bytes
    source: Any
    """Where an answer is to go; for the carrier only."""
    arrival_s: float
    """Monotonic time."""
    sender: int | None = None
    """The robot as whom the carrier let it through; None where the carrier tells nobody apart."""


class Carrier(Protocol):
    """Carries packets between the robots of a team; may lose, repeat and reorder them. Never blocks."""

    failures: Counter[str]
    """Packets that could not be sent or received, by the system's name of the cause."""

    def send(self, robot_id: int, packet: bytes) -> None:
        """Send a packet to a robot, once."""
        ...

    def reply(self, datagram: Datagram, packet: bytes) -> None:
        """Send a packet to where a received one came from, once."""
        ...

    def receive(self) -> Iterator[Datagram]:
        """Take the packets that have arrived, at most so many that a tick can afford them."""
        ...

    def close(self) -> None:
        """Give the network back."""
        ...


class UdpCarrier:
    """The default carrier: one socket, no router, no multicast.

    Args:
        own: where this robot listens and sends from.
        others: the other robots' endpoints by id.

    Raises:
        ConfigError: if this machine does not have the address, or another process holds the port.
    """

    def __init__(self, own: Endpoint, others: Mapping[int, Endpoint]) -> None:
        self.failures: Counter[str] = Counter()
        self._others = others
        self._buffer = memoryview(bytearray(PACKET_BYTES + 1))  # one more: longer ones must not look whole
        self._socket = socket.socket(socket.AF_INET6 if ":" in own[0] else socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(own)
        except OSError as error:
            self._socket.close()
            raise ConfigError(
                f"cannot listen on {own[0]} port {own[1]} ({error.strerror}); "
                "is this the right --robot-id for this machine, and does no other process run it?"
            ) from error
        self._arrivals = ArrivalClock(self._socket)

    def send(self, robot_id: int, packet: bytes) -> None:
        """Send a packet to a robot, once."""
        self._send(packet, self._others[robot_id])

    def reply(self, datagram: Datagram, packet: bytes) -> None:
        """Send a packet to where a received one came from, once."""
        self._send(packet, datagram.source)

    def receive(self) -> Iterator[Datagram]:
        """Take up to ``DRAIN`` packets; one that is longer than any of ours comes cut to one byte more."""
        self._arrivals.begin()
        for _ in range(DRAIN):
            try:
                size, ancillary, _, source = self._socket.recvmsg_into((self._buffer,), ANCILLARY_BYTES)
            except BlockingIOError:
                self._arrivals.emptied()
                return
            except OSError as error:
                self._count(error)
                continue
            yield Datagram(bytes(self._buffer[:size]), source, self._arrivals.arrival_s(ancillary))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, packet: bytes, target: Any) -> None:  # noqa: ANN401  # the socket module's addresses
        try:
            self._socket.sendto(packet, target)
        except OSError as error:  # a network that is away comes back: the loop must not end
            self._count(error)

    def _count(self, error: OSError) -> None:
        self.failures[errno.errorcode.get(error.errno or 0, str(error))] += 1
