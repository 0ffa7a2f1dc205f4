"""Notices who has ended unasked, and whether a signal asks to end, while a run starts and lasts."""

import signal
import time

from edge_runtime.common.signals import StopSignals
from edge_runtime.errors import BridgeError
from firmware_bridge.sil.measurement.processes import Child, ProcessGroup


class StartError(BridgeError):
    """The team did not come to drive: one of its processes ended, or took too long."""


class Lookout:
    """Looks when it is asked to.

    Args:
        processes: of the run.
        signals: end it.
    """

    def __init__(self, processes: ProcessGroup, signals: StopSignals) -> None:
        self._processes, self._signals = processes, signals
        self.ended: dict[str, str] = {}
        """Names of processes that ended though nobody asked them to, and how."""

    def look(self) -> None:
        """Take note of who has ended.

        Raises:
            KeyboardInterrupt: if Ctrl-C asks to end.
            BridgeError: if another signal does.
        """
        if self._signals.reason == signal.SIGINT.name:
            raise KeyboardInterrupt("interrupted, nothing was judged")
        if self._signals.reason:
            raise BridgeError(f"ended by {self._signals.reason}")
        for child in self._processes.children.values():
            code = child.popen.poll()
            surprising = code is not None and not child.expected_end and not _is_done(child, code)
            if surprising and child.name not in self.ended:
                self.ended[child.name] = f"{child.name} ended with {code}: {child.last_line()}"

    def look_before(self, end_s: float, complaint: str) -> None:
        """Look while the team starts.

        Raises:
            StartError: if one of its processes has ended, or it is later than ``end_s``.
        """
        self.look()
        if self.ended:
            raise StartError(f"the team did not start: {'; '.join(self.ended.values())}")
        if time.monotonic() > end_s:
            robots = [c for name, c in self._processes.children.items() if name.startswith("robot_")]
            words = "; ".join(f"{robot.name} said: {robot.last_line()}" for robot in robots)
            raise StartError(f"{complaint}: {words}")


def _is_done(child: Child, code: int) -> bool:
    """Whether a helper ended because its part was over."""
    return code == 0 and child.name.startswith(("hog_", "hostile_", "operator_"))
