"""An AgileX chassis at the far end of the bus."""

import subprocess
import time
from collections.abc import Callable

from can_peers import Obedient
from socketcan.adapter import Adapter
from waiting import HANG_S

from firmware_bridge.sil.firmware.agilex import AgilexChassis
from firmware_bridge.sil.firmware.node import FirmwareLoop, FirmwareNode

MODE = 0x421
TIMEOUT_S = 1.0
"""Longer than a real one's: a busy machine must not let it pass before the guard has stopped the robot."""


class Chassis(AgilexChassis):
    """Obeys, reports every 20 ms, and stops by itself a second after the last command."""

    def __init__(self, adapter: Adapter) -> None:
        super().__init__()
        self.timeout_s = TIMEOUT_S
        self.adapter = adapter
        self.frames: list[tuple[float, int, bytes]] = []
        self.on_command = lambda heard: self.frames.append((heard.arrival_s, *heard.packet[:2]))
        self._node = FirmwareNode(self, adapter)
        self._loop = FirmwareLoop(Obedient(), [self._node])

    def serve(
        self, seconds: float, until: Callable[[], bool] = lambda: False, listening: bool = True
    ) -> bool:
        """Act for some seconds; ``listening=False`` leaves commands in the transmit queue."""
        end_s = time.monotonic() + seconds
        if not listening:
            self._loop.forget(self.adapter.fileno())
        while time.monotonic() < end_s and not until():
            self._loop.turn(end_s)
        if not listening:
            self._loop.listen(self.adapter.fileno(), self._node.receive)
        return until()

    def set_interface(self, *arguments: str) -> None:
        """Configure the interface while the chassis goes on: the driver waits until the adapter has read."""
        setting = subprocess.Popen(["ip", "link", "set", self.adapter.interface, *arguments])
        assert self.serve(HANG_S, until=lambda: setting.poll() is not None)
        assert setting.returncode == 0, arguments
