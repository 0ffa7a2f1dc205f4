"""The far side of a SocketCAN interface: a serial CAN adapter (LAWICEL protocol) behind a pseudo terminal.

The kernel's own ``slcan`` driver makes the near side a CAN interface like any other, with a transmit queue,
controller states and error frames.
"""

import contextlib
import fcntl
import os
import struct
import termios
import time
import tty
from collections.abc import Iterator

from firmware_bridge.can.frame import Frame

SLCAN_LINE_DISCIPLINE = 17
STANDARD_FRAME = b"t"


class Adapter:
    """The adapter, a `Wire` of the harness: ``receive`` and ``send`` are its CAN connector."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        os.set_blocking(self._master, False)
        fcntl.ioctl(self._slave, termios.TIOCSETD, struct.pack("i", SLCAN_LINE_DISCIPLINE))
        self._received = b""
        self.plugged = True
        self.interface = self._find_interface()

    def _find_interface(self) -> str:
        reply = fcntl.ioctl(self._slave, 0x8910, bytes(40))  # SIOCGIFNAME
        return reply.split(b"\0")[0].decode()

    def unplug(self) -> None:
        """Pull the adapter out."""
        self.plugged = False
        os.close(self._slave)
        os.close(self._master)

    def fileno(self) -> int:
        return self._master

    def receive(self) -> Iterator[tuple[Frame, float]]:
        """Yield the frames that the interface has sent; while nobody calls this, its queue fills."""
        self._read()
        *lines, self._received = self._received.split(b"\r")
        for line in lines:
            if line[:1] == STANDARD_FRAME:
                yield _frame(line), time.monotonic()

    def send(self, packet: Frame) -> None:
        """Hand a frame to the interface."""
        words = (STANDARD_FRAME, packet.frame_id, len(packet.data), packet.data.hex().encode())
        os.write(self._master, b"%s%03X%d%s\r" % words)

    def close(self) -> None:
        """Stay: the next chassis takes it over."""

    def go_bus_off(self) -> None:
        """Report what a controller reports after 256 transmit errors."""
        os.write(self._master, b"sb000255\r")

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._received += os.read(self._master, 4096)


def _frame(line: bytes) -> Frame:
    return Frame(int(line[1:4], 16), bytes.fromhex(line[5:].decode()))
