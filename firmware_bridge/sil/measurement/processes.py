"""Child processes that never outlive the harness, and what they cost, after Linux's /proc."""

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from edge_runtime.common.child import python_command
from edge_runtime.common.closing import Closing
from edge_runtime.recording import logger_process
from firmware_bridge.guard import process as guard_process

_PR_SET_PDEATHSIG = 1
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_libc = ctypes.CDLL(None, use_errno=True)

PARTS = {guard_process.__name__: "guard", logger_process.__name__: "logger"}
"""A robot's processes beside its runtime, by the modules that they run."""
LEAVING_S = 20.0
"""Longest wait for a process that was asked to end: more than a guard's longest stop sequence."""


class Usage(msgspec.Struct, frozen=True):
    """What one process has cost so far."""

    cpu_s: float
    memory_bytes: int
    """Resident."""


class Child:
    """One process that the harness started, in a group of its own."""

    def __init__(self, name: str, popen: "subprocess.Popen[str]", output: Path) -> None:
        self.name, self.popen, self.output = name, popen, output
        self.expected_end = False
        """Whether its end is no surprise: it was asked to end, or a fault killed it."""

    def tell(self, line: str) -> None:
        """Write one line to its standard input; one that has ended does not hear it."""
        assert self.popen.stdin is not None  # noqa: S101 - for the type checker
        with contextlib.suppress(OSError):
            self.popen.stdin.write(line + "\n")
            self.popen.stdin.flush()

    def last_line(self) -> str:
        """Return the last line that it wrote."""
        lines = self.output.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"


class ProcessGroup(Closing):
    """The run's processes; leaving the context ends all of them, and their children.

    Args:
        folder: where their output goes.
    """

    def __init__(self, folder: Path) -> None:
        self.children: dict[str, Child] = {}
        self._folder = folder
        self._grandchildren: dict[int, int] = {}

    def close(self) -> None:
        """Kill whatever is left."""
        self.notice_grandchildren()
        for child in self.children.values():
            child.expected_end = True
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.popen.pid, signal.SIGKILL)
            child.popen.wait()
        for descriptor in self._grandchildren.values():
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(descriptor, signal.SIGCONT)
                signal.pidfd_send_signal(descriptor, signal.SIGKILL)
            os.close(descriptor)

    def start(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        environment: dict[str, str] | None = None,
        *,
        answers: bool = False,
    ) -> Child:
        """Start a module in a session of its own, bound to the life of this process.

        Its standard output is a pipe if it ``answers``, else a file with its standard error.
        """
        output = self._folder / f"{name}.out"
        with output.open("w") as file:
            popen = subprocess.Popen(  # noqa: S603 - our own interpreter and modules
                python_command(module, *arguments),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if answers else file,
                stderr=file,
                text=True,
                start_new_session=True,
                preexec_fn=_die_with(os.getpid()),  # noqa: PLW1509 - the harness has no threads
                env={**os.environ, **(environment or {})},
            )
        self.children[name] = Child(name, popen, output)
        return self.children[name]

    def ask_to_end(self, children: Sequence[Child]) -> list[str]:
        """Send SIGTERM and wait; returns the names of those that had to be killed."""
        for child in children:
            child.expected_end = True
            child.popen.send_signal(signal.SIGTERM)
        end_s, slow = time.monotonic() + LEAVING_S, []
        for child in children:
            try:
                child.popen.wait(max(end_s - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                slow.append(child.name)
        return slow

    def notice_grandchildren(self) -> dict[str, int]:
        """Return the living descendants of each child by ``name/part``, and remember to end them."""
        found = {}
        parents = _parents()
        for child in self.children.values():
            for pid, parent in parents.items():
                if parent == child.popen.pid:
                    found[f"{child.name}/{_part(pid)}"] = pid
                    if pid not in self._grandchildren:
                        with contextlib.suppress(OSError):
                            self._grandchildren[pid] = os.pidfd_open(pid)
        return found


def usage(pid: int) -> Usage | None:
    """Return what a process has cost so far, or None if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return Usage((int(fields[11]) + int(fields[12])) / _TICKS_PER_S, int(fields[21]) * _PAGE_BYTES)


def machine_busy_s() -> float:
    """Return the processor time that all processes took so far, with what a hypervisor stole."""
    user, nice, system, _idle, _io, _irq, _soft, stolen = map(
        int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]
    )
    return (user + nice + system + stolen) / _TICKS_PER_S


def _die_with(parent: int) -> Callable[[], None]:
    def prepare() -> None:
        _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent died before it could be watched
            os._exit(1)

    return prepare


def _parents() -> dict[int, int]:
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
    return parents


def _part(pid: int) -> str:
    """Return which of a robot's processes this is, by the module that it runs."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return "other"
    return next((part for module, part in PARTS.items() if module in words), "other")
