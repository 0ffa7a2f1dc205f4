"""Bytes to and from the autopilot: UDP or a serial port, never blocking."""

import errno
import socket
from collections.abc import Iterator
from typing import Protocol

from edge_runtime.errors import BridgeError, ConfigError

DATAGRAM_BYTES = 65535
DATAGRAMS_A_PASS = 64
"""Read before setpoints get their turn: a flood must not hold up a stop."""

FORMS = "udpin:HOST:PORT, udpout:HOST:PORT or serial:DEVICE:BAUD"
Address = tuple[str, int]
CABLE: Address = ("", 0)
"""The one other end of a serial port."""


class Transport(Protocol):
    """One way to the autopilot."""

    datagrams: bool
    """Whether each portion holds whole frames."""
    sender: Address
    """Who sent the last portion."""
    dropped: int
    """Frames that the port did not take, or of which the network said that they did not arrive."""

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
    """``udpin`` waits for the autopilot's first frame to learn its address, ``udpout`` knows it."""

    datagrams = True

    def __init__(self, host: str, port: int, listens: bool) -> None:
        address = (host, port)
        self.sender = address
        self.dropped = 0
        self._peer: Address | None = None if listens else address
        self._listens = listens
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            if listens:
                self._socket.bind(address)
            else:
                self._socket.connect(address)
        except OSError as error:
            self._socket.close()
            raise BridgeError(f"--mavlink {host}:{port}: {error.strerror}; is it this machine's?") from error

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def receive(self) -> Iterator[bytes]:
        """Yield one datagram after the other."""
        for _ in range(DATAGRAMS_A_PASS):
            try:
                data, self.sender = self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno == errno.EBADF:
                    raise  # Ours, not the network's.
                self.dropped += 1  # ICMP: nobody is there yet, no route, prohibited. Missing heartbeats tell.
                continue
            yield data

    def answer(self, sender: Address) -> None:
        """Send there from now on."""
        if self._listens:
            self._peer = sender

    def send(self, frame: bytes) -> None:
        """Send one datagram; a full queue, a missing peer or route drops it."""
        try:
            if self._peer is None:
                self.dropped += 1
            elif self._listens:
                self._socket.sendto(frame, self._peer)
            else:
                self._socket.send(frame)
        except OSError:
            self.dropped += 1

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
