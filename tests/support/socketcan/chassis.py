"""An AgileX chassis (protocol 2, after its manual) at the far end of the bus."""

import subprocess
import time
from collections.abc import Callable

from socketcan.adapter import Adapter
from waiting import HANG_S

MOTION, MODE, SYSTEM_STATE, MOTION_STATE = 0x111, 0x421, 0x211, 0x221
REPORT_S = 0.02
TIMEOUT_S = 1.0
"""Longer than a real one's: a busy machine must not let it pass before the guard has stopped the robot."""


class Chassis:
    """Obeys, reports every 20 ms, and stops by itself a second after the last command."""

    def __init__(self, adapter: Adapter) -> None:
        self.adapter = adapter
        self.frames: list[tuple[float, int, bytes]] = []
        self.speed = b"\0\0"
        self.timed_out_s: float | None = None
        self._mode = 0
        self._report_s = time.monotonic()
        self._heard_s = self._report_s

    def serve(
        self, seconds: float, until: Callable[[], bool] = lambda: False, listening: bool = True
    ) -> bool:
        """Act for some seconds; ``listening=False`` leaves commands in the transmit queue."""
        end_s = time.monotonic() + seconds
        while (now_s := time.monotonic()) < end_s and not until():
            if now_s >= self._report_s:
                self._report()
            if not listening:
                time.sleep(REPORT_S / 4)
                continue
            self.adapter.wait(max(self._report_s - now_s, 0.0))
            for frame_id, data in self.adapter.receive():
                self._take(frame_id, data)
        return until()

    def set_interface(self, *arguments: str) -> None:
        """Configure the interface while the chassis goes on: the driver waits until the adapter has read."""
        setting = subprocess.Popen(["ip", "link", "set", self.adapter.interface, *arguments])
        assert self.serve(HANG_S, until=lambda: setting.poll() is not None)
        assert setting.returncode == 0, arguments

    def _take(self, frame_id: int, data: bytes) -> None:
        now_s = time.monotonic()
        self.frames.append((now_s, frame_id, data))
        if frame_id == MODE:
            self._mode = data[0]
        if frame_id == MOTION:
            self.speed, self._heard_s = data[:2], now_s

    def _report(self) -> None:
        self._report_s += REPORT_S
        if self.speed != b"\0\0" and time.monotonic() - self._heard_s > TIMEOUT_S:
            self.speed, self.timed_out_s = b"\0\0", time.monotonic()
        self.adapter.send(SYSTEM_STATE, bytes([0, self._mode, 0x01, 0x00, 0, 0, 0, 0]))
        self.adapter.send(MOTION_STATE, self.speed + bytes(6))
