"""A serial port to the autopilot: UART or USB."""

import contextlib
from collections.abc import Iterator

import serial

from edge_runtime.errors import BridgeError
from firmware_bridge.mavlink.transport import CABLE, Address

READ_BYTES = 4096
LONGEST_QUEUE = 256
"""Bytes that may wait in the port: more would be setpoints of the past."""


class SerialTransport:
    """A serial port or USB, 8N1, used by nobody else."""

    datagrams = False
    sender = CABLE

    def __init__(self, device: str, baud: int) -> None:
        self.dropped = 0
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise BridgeError(f"--mavlink serial:{device}:{baud}: {error}") from error

    def fileno(self) -> int:
        """Return the port's descriptor."""
        return int(self._port.fileno())

    def receive(self) -> Iterator[bytes]:
        """Yield what is there.

        Raises:
            BridgeError: if the port is gone, such as an unplugged cable.
        """
        try:
            data = self._port.read(READ_BYTES)
        except OSError as error:
            raise BridgeError(f"serial port {self._port.name}: {error}") from error
        if data:
            yield data

    def answer(self, sender: Address) -> None:
        """Nothing to do: a cable has one other end."""

    def send(self, frame: bytes) -> None:
        """Send one frame unless older ones still wait.

        Raises:
            BridgeError: if the port is gone.
        """
        try:
            waits = self._port.out_waiting > LONGEST_QUEUE
            self.dropped += waits or self._port.write(frame) != len(frame)
        except OSError as error:
            raise BridgeError(f"serial port {self._port.name}: {error}") from error

    def close(self) -> None:
        """Close the port."""
        with contextlib.suppress(OSError):
            self._port.close()
