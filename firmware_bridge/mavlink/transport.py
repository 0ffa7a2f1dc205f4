"""Bytes to and from the autopilot: UDP or a serial port, never blocking."""

from collections.abc import Iterator
from typing import Protocol

from edge_runtime.errors import BridgeError, ConfigError
from edge_runtime.network.datagrams import call, listen

DATAGRAM_BYTES = 65535

FORMS = "udpin:HOST:PORT, udpout:HOST:PORT or serial:DEVICE:BAUD"
Address = tuple[str, int]
QUESTION = "is the address this machine's, and does no other station listen there?"
CABLE: Address = ("", 0)
"""The one other end of a serial port."""


class Transport(Protocol):
    """One way to the autopilot."""

    datagrams: bool
    """Whether each portion holds whole frames."""
    sender: Address
    """Who sent the last portion."""

    @property
    def dropped(self) -> int:
        """Frames that the port did not take, or of which the network said that they did not arrive."""
        ...

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        ...

    def receive(self) -> Iterator[bytes]:
        """Yield what has arrived."""
        ...

    def answer(self, sender: Address) -> None:
        """Send to this sender from now on."""
        ...

    def send(self, frame: bytes) -> None:
        """Send one frame now, or drop and count it."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...


class UdpTransport:
    """``udpin`` waits for the autopilot's first frame to learn its address, ``udpout`` knows it.

    Raises:
        BridgeError: if the address is not this machine's, its port is in use, or the name leads nowhere.
    """

    datagrams = True

    def __init__(self, host: str, port: int, listens: bool) -> None:
        self.sender = (host, port)
        self._peer: Address | None = None if listens else self.sender
        self._listens = listens
        self._unsent = 0
        try:
            self._socket = (
                listen(self.sender, DATAGRAM_BYTES, QUESTION)
                if listens
                else call(self.sender, DATAGRAM_BYTES)
            )
        except ConfigError as error:
            raise BridgeError(f"--mavlink: {error}") from error

    @property
    def dropped(self) -> int:
        """Frames without anybody to send to, and what the system or the network could not take."""
        return self._unsent + self._socket.failures.total()

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def receive(self) -> Iterator[bytes]:
        """Yield one datagram after the other."""
        for datagram in self._socket.receive():
            self.sender = datagram.source
            yield datagram.content

    def answer(self, sender: Address) -> None:
        """Send there from now on."""
        if self._listens:
            self._peer = sender

    def send(self, frame: bytes) -> None:
        """Send one datagram; a full queue, a missing peer or route drops it."""
        if self._peer is None:
            self._unsent += 1
        else:
            self._socket.send(frame, self._peer)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def open_transport(address: str) -> Transport:
    """Open ``udpin:HOST:PORT``, ``udpout:HOST:PORT`` or ``serial:DEVICE:BAUD``.

    Raises:
        ConfigError: if the address has none of these forms.
        BridgeError: if it cannot be opened.
    """
    kind, host, number = parse_address(address)
    if kind == "serial":
        from firmware_bridge.mavlink.serial_port import SerialTransport  # noqa: PLC0415 - UDP does not pay for it

        return SerialTransport(host, number)
    return UdpTransport(host, number, listens=kind == "udpin")


def parse_address(address: str) -> tuple[str, str, int]:
    """Split an address into its kind, its host or device, and its port or baud rate.

    Raises:
        ConfigError: if it has none of the known forms.
    """
    kind, _, rest = address.partition(":")
    host, _, number = rest.rpartition(":")
    fits = kind in ("udpin", "udpout", "serial") and host and number.isascii() and number.isdigit()
    if not fits or (kind != "serial" and not 0 < int(number) < 65536):
        raise ConfigError(f"--mavlink {address!r} is no address; write {FORMS}")
    return kind, host, int(number)
