"""``--bus sim``: an AgileX chassis in the guard's own process, for CAN commands with nothing plugged in.

python-can finds it by its name, as it finds every adapter's driver of another package. Frames pass through a
pair of sockets, so that guard, codec and profile work as on a wire; the firmware answers from a thread, with
its own command timeout. The chassis drives alone: it meets nobody, and CAN tells no position anyway.
"""

import socket
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Final

import can

from firmware_bridge.can.frame import Frame
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.agilex import AgilexChassis
from firmware_bridge.sil.firmware.node import STEP_S, FirmwareLoop, FirmwareNode
from firmware_bridge.sil.firmware.world import BaseState

GREATEST_CHANGE: Final = (2.0 * STEP_S, 8.0 * STEP_S)
"""Of forward speed (m/s) and yaw rate (rad/s) in a step: what the profile's own stop takes the brakes for."""
_FRAME: Final = struct.Struct("=IB3x8s")
"""Identifier, length, data: Linux's own classical frame."""
_EXTENDED: Final = 1 << 31


class SimulatedBus(can.BusABC):
    """A bus with one chassis on it; gone with the process that opened it."""

    def __init__(self, channel: str) -> None:
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._ours.setblocking(False)
        self.channel_info = "a simulated chassis"
        self._over = threading.Event()
        self._firmware = threading.Thread(target=self._serve, args=(theirs,), name="firmware", daemon=True)
        super().__init__(channel)
        self._firmware.start()

    def fileno(self) -> int:
        """Return the descriptor that is readable when frames have arrived."""
        return self._ours.fileno()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        """Hand one frame to the chassis."""
        self._ours.send(_packed(Frame(msg.arbitration_id, bytes(msg.data), msg.is_extended_id)))

    def shutdown(self) -> None:
        """Switch the chassis off."""
        super().shutdown()
        self._over.set()
        self._firmware.join()
        self._ours.close()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        try:
            frame = _unpacked(self._ours.recv(_FRAME.size))
        except BlockingIOError:
            return None, True
        message = can.Message(arbitration_id=frame.frame_id, data=frame.data, is_extended_id=frame.extended)
        return message, True

    def _serve(self, end: socket.socket) -> None:
        with FirmwareLoop(Chassis(), [FirmwareNode(AgilexChassis(), SocketWire(end))], 1) as loop:
            while not self._over.is_set():
                loop.turn()


class Chassis:
    """The plant: speeds that follow what is asked as fast as `GREATEST_CHANGE` allows."""

    def __init__(self) -> None:
        self._forward_m_s = self._yaw_rad_s = 0.0

    def step(self, motions: Sequence[BaseMotion]) -> None:
        """Advance by STEP_S towards the one motion asked for."""
        (told,), (most_forward, most_yaw) = motions, GREATEST_CHANGE
        self._forward_m_s += min(max(told.forward_m_s - self._forward_m_s, -most_forward), most_forward)
        self._yaw_rad_s += min(max(told.yaw_rad_s - self._yaw_rad_s, -most_yaw), most_yaw)

    def state(self, robot: int) -> BaseState:  # noqa: ARG002  # there is one
        """Return the speeds; nobody asks where it is."""
        return BaseState((0.0, 0.0), 0.0, self._forward_m_s, self._yaw_rad_s)


class SocketWire:
    """The firmware's end of the pair."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        end.setblocking(False)

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._end.fileno()

    def receive(self) -> Iterator[tuple[Frame, float]]:
        """Yield each frame with the monotonic time at which it was taken off the wire."""
        while True:
            try:
                packet = self._end.recv(_FRAME.size)
            except BlockingIOError:
                return
            yield _unpacked(packet), time.monotonic()

    def send(self, packet: Frame) -> None:
        """Send one frame; one that nobody takes any more is lost."""
        try:
            self._end.send(_packed(packet))
        except BlockingIOError:
            return

    def close(self) -> None:
        """Let go."""
        self._end.close()


def _packed(frame: Frame) -> bytes:
    identifier = frame.frame_id | _EXTENDED * frame.extended
    return _FRAME.pack(identifier, len(frame.data), frame.data)


def _unpacked(packet: bytes) -> Frame:
    identifier, length, data = _FRAME.unpack(packet)
    return Frame(identifier & ~_EXTENDED, data[:length], bool(identifier & _EXTENDED))
