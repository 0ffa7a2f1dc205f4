"""What takes packets between the robots of a team, and the default: UDP unicast."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final, Protocol

from edge_runtime.config.network import Endpoint
from edge_runtime.network.datagrams import Datagram, listen
from edge_runtime.network.order_wire import PACKET_BYTES

QUESTION: Final = "is this the right --robot-id for this machine, and does no other process run it?"


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

    def fileno(self) -> int:
        """Return the descriptor that is readable when a stream's packets have arrived."""
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
        self._datagrams, self._others = listen(own, PACKET_BYTES, QUESTION), others
        self.failures = self._datagrams.failures

    def send(self, robot_id: int, packet: bytes) -> None:
        """Send a packet to a robot, once."""
        self._datagrams.send(packet, self._others[robot_id])

    def reply(self, datagram: Datagram, packet: bytes) -> None:
        """Send a packet to where a received one came from, once."""
        self._datagrams.send(packet, datagram.source)

    def receive(self) -> Iterator[Datagram]:
        """Take up to `edge_runtime.network.datagrams.DRAIN` packets."""
        return self._datagrams.receive()

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._datagrams.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._datagrams.close()
