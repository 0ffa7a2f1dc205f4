"""Bytes to and from the autopilot: UDP or a serial port, never blocking."""

import socket
from collections.abc import Iterator
from typing import Protocol

from edge_runtime.errors import BridgeError, ConfigError

DATAGRAM_BYTES = 65535
DATAGRAMS_A_PASS = 64
"""Read before setpoints get their turn: a flood must not hold up a stop."""

FORMS = "udpin:HOST:PORT, udpout:HOST:PORT or serial:DEVICE:BAUD"


class Transport(Protocol):
    """One way to the autopilot."""

    datagrams: bool
    """Whether each portion holds whole frames."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        ...

    def receive(self) -> Iterator[bytes]:
        """Yield what has arrived."""
        ...

    def answer_sender(self, proved: bool) -> None:
        """Send to whoever sent the last portion, if it ``proved`` to be the autopilot or nobody has."""
        ...

    def send(self, frame: bytes) -> bool:
        """Send one frame now, or return False."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...


class UdpTransport:
    """``udpin`` waits for the autopilot's first frame to learn its address, ``udpout`` knows it."""

    datagrams = True

    def __init__(self, host: str, port: int, listens: bool) -> None:
        address = (host, port)
        self._peer: tuple[str, int] | None = None if listens else address
        self._sender = address
        self._proved = False
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
                data, self._sender = self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except ConnectionRefusedError:
                continue  # An autopilot that is not up yet; its missing heartbeat tells.
            yield data

    def answer_sender(self, proved: bool) -> None:
        """Send there from now on."""
        if self._listens and (proved or not self._proved):
            self._peer, self._proved = self._sender, proved

    def send(self, frame: bytes) -> bool:
        """Send one datagram; a full queue or a missing peer drops it."""
        if self._peer is None:
            return False
        try:
            if self._listens:
                self._socket.sendto(frame, self._peer)
            else:
                self._socket.send(frame)
        except OSError:
            return False
        return True

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
