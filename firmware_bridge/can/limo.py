"""AgileX Limo: CAN-like frames over its serial port, 14 bytes each at 460800 baud.

0x55, 0x0E, identifier (2 bytes, big endian), 8 data bytes, counter, sum of the data bytes modulo 256.
Source: the vendor's public ROS driver, limo_base.
"""

import os
import select
from collections.abc import Iterable, Iterator

import serial

from edge_runtime.errors import BridgeError
from firmware_bridge.can.frame import Frame, Identifier

BAUD = 460_800
HEADER = b"\x55\x0e"
FRAME_BYTES = 14
READ_BYTES = 4096


def frame_bytes(frame: Frame, counter: int) -> bytes:
    """Return a frame as the Limo expects it; ``counter`` counts frames modulo 256."""
    data = frame.data.ljust(8, b"\0")
    return HEADER + frame.frame_id.to_bytes(2, "big") + data + bytes([counter, sum(data) & 0xFF])


class FrameReader:
    """Finds frames in a stream of bytes; bytes that belong to none are skipped one by one."""

    def __init__(self) -> None:
        self.malformed = 0
        """Frames refused for their checksum."""
        self._buffer = b""

    def feed(self, received: bytes) -> Iterator[Frame]:
        """Take bytes in and yield every frame that they complete."""
        self._buffer += received
        while (start := self._buffer.find(HEADER)) >= 0 and len(self._buffer) - start >= FRAME_BYTES:
            candidate = self._buffer[start : start + FRAME_BYTES]
            data = candidate[4:12]
            if sum(data) & 0xFF == candidate[13]:
                self._buffer = self._buffer[start + FRAME_BYTES :]
                yield Frame(int.from_bytes(candidate[2:4], "big"), data)
            else:
                self.malformed += 1
                self._buffer = self._buffer[start + 1 :]
        self._buffer = self._buffer[start:] if start >= 0 else self._buffer[-1:]


class LimoPort:
    """The Limo's serial port as a Transport."""

    def __init__(self, device: str) -> None:
        self._device = device
        self._port: serial.Serial | None = None
        self._reader = FrameReader()
        self._counter = 0

    @property
    def malformed(self) -> int:
        """Frames refused for their checksum."""
        return self._reader.malformed

    def open(self) -> None:
        """Open the port for this process alone.

        Raises:
            BridgeError: if there is no such port or it is in use.
        """
        try:
            self._port = serial.Serial(self._device, BAUD, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, ValueError) as error:
            raise BridgeError(f"--bus {self._device}: the serial port cannot be opened ({error})") from error

    def hear_only(self, identifiers: Iterable[Identifier]) -> None:
        """No serial port knows what it carries."""

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def fileno(self) -> int:
        """File descriptor of the port."""
        if self._port is None:
            raise BridgeError(f"the serial port {self._device} is not open")
        return int(self._port.fileno())

    def send(self, frame: Frame) -> bool:
        """Write one frame; False if the port's buffer is full."""
        raw = frame_bytes(frame, self._counter)
        try:
            written = os.write(self.fileno(), raw)  # pyserial's write would spin on a full buffer.
        except BlockingIOError:
            return False
        except OSError as error:
            raise BridgeError(f"the serial port {self._device} is lost ({error})") from error
        self._counter = (self._counter + 1) & 0xFF
        return written == FRAME_BYTES

    def receive(self) -> Iterator[Frame]:
        """Yield the frames that have arrived."""
        readable, _, _ = select.select((self.fileno(),), (), (), 0.0)
        if not readable:
            return
        try:
            received = os.read(self.fileno(), READ_BYTES)
        except OSError as error:
            raise BridgeError(f"the serial port {self._device} is lost ({error})") from error
        if not received:
            raise BridgeError(f"the serial port {self._device} is lost (hung up)")
        yield from self._reader.feed(received)
