"""Does what the timeline asks of processes: kill, freeze, let the clock jump, fill the disk."""

import contextlib
import os
import resource
import signal
import time
from collections.abc import Callable

from edge_runtime.errors import BridgeError
from firmware_bridge.sil.measurement.processes import ProcessGroup
from firmware_bridge.sil.scenario.faults import (
    AnyFault,
    ClockJump,
    EmergencyStop,
    Freeze,
    Kill,
    LogFull,
    Objectives,
)

Injection = Callable[[], None]


class Injector:
    """What a timeline does to processes, in its order; other processes follow the rest of it by themselves.

    Args:
        faults: the timeline.
        processes: whose are meant; a robot's runtime is the child ``robot_K``.
        fleet_file: the team's, for its operator.
    """

    def __init__(self, faults: tuple[AnyFault, ...], processes: ProcessGroup, fleet_file: str) -> None:
        self._processes, self._fleet_file = processes, fleet_file
        self._clock_ahead_s = 0.0
        self.done_s: dict[int, float] = {}
        """When each fault, by its place in the timeline, was done, in the run's time."""
        self._due: list[tuple[float, int, Injection]] = []
        for index, fault in enumerate(faults):
            self._plan(index, fault)
        self._due.sort(key=lambda item: item[:2])

    @property
    def next_s(self) -> float:
        """When the next one is due, in the run's time."""
        return self._due[0][0] if self._due else float("inf")

    def act(self, elapsed_s: float) -> None:
        """Do what is due."""
        while self._due and self._due[0][0] <= elapsed_s:
            _, index, inject = self._due.pop(0)
            inject()
            self.done_s.setdefault(index, elapsed_s)

    def restore(self) -> None:
        """Undo what would keep processes from ending in good order."""
        for _, _, inject in self._due:
            inject()
        self._due.clear()
        self._jump(-self._clock_ahead_s)

    def _plan(self, index: int, fault: AnyFault) -> None:
        match fault:
            case Kill():
                self._add(fault.at_s, index, lambda: self._signal(fault.robot, fault.part, signal.SIGKILL))
            case Freeze():
                self._add(fault.at_s, index, lambda: self._signal(fault.robot, fault.part, signal.SIGSTOP))
                self._add(fault.end_s, index, lambda: self._signal(fault.robot, fault.part, signal.SIGCONT))
            case EmergencyStop():  # pressed by the world; its runtime ends in good order
                self._add(fault.at_s, index, lambda: self._expect_end(fault.robot))
            case ClockJump():
                self._add(fault.at_s, index, lambda: self._jump(fault.by_s))
            case Objectives():
                self._add(fault.at_s, index, lambda: self._order(index, fault.file))
            case LogFull():
                self._add(fault.at_s, index, lambda: self._limit_files(0))
                self._add(fault.end_s, index, lambda: self._limit_files(resource.RLIM_INFINITY))

    def _add(self, at_s: float, index: int, inject: Injection) -> None:
        self._due.append((at_s, index, inject))

    def _signal(self, robot: int, part: str, number: signal.Signals) -> None:
        child = self._processes.children[f"robot_{robot}"]
        if number != signal.SIGCONT and part != "logger":
            self._expect_end(robot)
        pid = child.popen.pid if part == "runtime" else self._part(child.name, part)
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)

    def _expect_end(self, robot: int) -> None:
        self._processes.children[f"robot_{robot}"].expected_end = True

    def _part(self, name: str, part: str) -> int:
        parts = self._processes.notice_grandchildren()
        if f"{name}/{part}" not in parts:
            raise BridgeError(f"{name} has no {part} to break")
        return parts[f"{name}/{part}"]

    def _order(self, index: int, file: str) -> None:
        arguments = ("objectives", file, "--fleet", self._fleet_file)
        self._processes.start(f"operator_{index}", "edge_runtime.tools.ctl.edge_ctl", arguments)

    def _jump(self, seconds: float) -> None:
        if seconds:
            self._clock_ahead_s += seconds
            time.clock_settime(time.CLOCK_REALTIME, time.time() + seconds)

    def _limit_files(self, size: int) -> None:
        """Let no regular file of the robots grow beyond ``size`` bytes."""
        pids = {name: child.popen.pid for name, child in self._processes.children.items()}
        every = {**pids, **self._processes.notice_grandchildren()}
        for name, pid in every.items():
            if name.startswith("robot_"):
                with contextlib.suppress(ProcessLookupError):
                    resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
