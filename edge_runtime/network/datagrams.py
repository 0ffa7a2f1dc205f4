"""Datagrams over UDP: nothing waits, nothing raises, what fails is counted."""

import errno
import select
import socket
from collections import Counter
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from edge_runtime.common.closing import Closing
from edge_runtime.config.network import Endpoint
from edge_runtime.errors import AddressTakenError, ConfigError
from edge_runtime.network.arrival_time import ANCILLARY_BYTES, ArrivalClock

DRAIN: Final = 256
"""Most datagrams taken at a time, about what the kernel queues: a flood costs a bounded time."""


class Datagram(NamedTuple):
    """A packet as it was received."""

    content: bytes
    source: Any
    """Where an answer is to go."""
    arrival_s: float
    """Monotonic time."""
    sender: int | None = None
    """The robot as whom its carrier let it through; None where the carrier tells nobody apart."""


class Datagrams(Closing):
    """A socket for datagrams.

    Args:
        opened: the socket.
        longest: bytes of the longest packet that anybody sends here; longer ones come cut to one byte more.
    """

    def __init__(self, opened: socket.socket, longest: int) -> None:
        self.failures: Counter[str] = Counter()
        """What could not be sent or received, by the system's name of the cause."""
        self._socket = opened
        self._socket.setblocking(False)
        self._buffer = memoryview(bytearray(longest + 1))  # one more: longer ones must not look whole
        self._arrivals = ArrivalClock(opened)

    def send(self, packet: bytes, target: Any) -> None:  # noqa: ANN401  # the socket module's addresses
        """Send a packet, once; a network that is away comes back."""
        try:
            self._socket.sendto(packet, target)
        except OSError as error:
            self._count(error)

    def receive(self) -> Iterator[Datagram]:
        """Take up to ``DRAIN`` packets."""
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

    @property
    def place(self) -> Endpoint:
        """Where it listens."""
        host, port, *_ = self._socket.getsockname()
        return host, port

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def wait(self, seconds: float) -> bool:
        """Wait for packets for at most so long; whether there are any."""
        return bool(select.select((self._socket,), (), (), max(0.0, seconds))[0])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _count(self, error: OSError) -> None:
        self.failures[errno.errorcode.get(error.errno or 0, str(error))] += 1


def listen(place: Endpoint, longest: int, question: str) -> Datagrams:
    """Open a socket that others send to.

    Raises:
        ConfigError: if this machine does not have the address; ends in ``question``.
        AddressTakenError: if another process holds the port.
    """
    opened = _socket(place[0])
    try:
        opened.bind(place)
    except OSError as error:
        opened.close()
        kind = AddressTakenError if error.errno == errno.EADDRINUSE else ConfigError
        raise kind(f"cannot listen on {place[0]} port {place[1]} ({error.strerror}); {question}") from error
    return Datagrams(opened, longest)


def speak(host: str, longest: int) -> Datagrams:
    """Open a socket that sends to machines such as ``host``, and hears their answers."""
    return Datagrams(_socket(host), longest)


def call(place: Endpoint, longest: int) -> Datagrams:
    """Open a socket for one other end: nobody else is heard.

    Raises:
        ConfigError: if the place's name leads nowhere.
    """
    opened = _socket(place[0])
    try:
        opened.connect(place)
    except OSError as error:
        opened.close()
        raise ConfigError(f"cannot reach {place[0]} port {place[1]} ({error.strerror})") from error
    return Datagrams(opened, longest)


def _socket(host: str) -> socket.socket:
    return socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
