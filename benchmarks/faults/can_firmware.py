"""An AgileX chassis (protocol 2) on a UDP multicast bus."""

import random
from collections.abc import Iterator

import can
import msgspec

from benchmarks.faults.firmware import DEADLINE_S, Firmware, Heard, free_port, to_monotonic
from firmware_bridge.can.feedback import Pose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.link import CanOptions
from firmware_bridge.can.profile import profile_path
from firmware_bridge.guard.link import Limits
from firmware_bridge.guard.spec import GuardSpec

PROFILE = profile_path("agilex_v2")
COMMANDED = (500).to_bytes(2, "big")
"""0.5 m/s."""
_MOTION, _BRAKE, _MODE, _CLEAR = 0x111, 0x131, 0x421, 0x441
_BUS_OFF = 0x40


def driving_frame() -> Frame:
    """Return the frame of 0.5 m/s straight on."""
    return Frame(_MOTION, COMMANDED + bytes(6))


class CanFirmware(Firmware):
    """Takes command through 0x421, answers with 0x211 and 0x221."""

    name = "can"

    def __init__(self) -> None:
        super().__init__()
        self._channel = f"239.75.{random.randrange(256)}.{random.randrange(1, 255)}"
        self._port = free_port()
        self._bus = can.Bus(interface="udp_multicast", channel=self._channel, port=self._port)
        self._mode, self._speed = 0, bytes(2)

    def spec(self) -> GuardSpec:
        """Return what a guard of this chassis is started with."""
        address = f"udp_multicast:{self._channel}?port={self._port}"
        options = msgspec.json.encode(CanOptions(address, str(PROFILE), Pose()))
        return GuardSpec("can", 0, DEADLINE_S, Limits(1.5, 1.0), msgspec.Raw(options), arm=True)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def fileno(self) -> int:
        """Return the bus's descriptor."""
        return self._bus.fileno()

    def tell_bus_off(self) -> None:
        """Put the error frame on the bus by which a kernel reports that its controller went bus-off."""
        self._bus.send(can.Message(arbitration_id=_BUS_OFF, is_error_frame=True, data=bytes(8)))

    def commands(self) -> Iterator[tuple[float | str, ...]]:
        """Yield identifier and data of each frame."""
        for message in self._arrived():
            yield message.arbitration_id, message.data.hex()

    def _receive(self) -> Iterator[Heard]:
        for message in self._arrived():
            frame_id, data = message.arbitration_id, bytes(message.data)
            self._obey(frame_id, data)
            yield Heard(to_monotonic(message.timestamp), frame_id == _MOTION and data[:2] == COMMANDED)

    def _arrived(self) -> Iterator[can.Message]:
        while (message := self._bus.recv(timeout=0)) is not None:
            if message.arbitration_id in (_MOTION, _BRAKE, _MODE, _CLEAR) and not message.is_error_frame:
                yield message

    def _obey(self, frame_id: int, data: bytes) -> None:
        if frame_id == _MODE:
            self._mode = data[0]
        elif frame_id == _MOTION:
            self._speed = data[:2]

    def _report(self) -> None:
        system = bytes([0, self._mode, 0x01, 0x00, 0, 0, 0, 0])
        for frame_id, data in ((0x211, system), (0x221, self._speed + bytes(6))):
            self._bus.send(can.Message(arbitration_id=frame_id, data=data, is_extended_id=False))
