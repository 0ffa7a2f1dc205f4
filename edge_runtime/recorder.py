"""The loop's side of its log: hands each tick to the logger's process and never waits for it.

Handing over costs one encoding and one `send` after the command is out. A socket that is full, because the
logger is held up, costs the newest tick, which is counted. Why a process and not a thread: a thread's
encoding holds the interpreter's lock at moments of its own choosing, and holds it longest where real-time
scheduling lets something else run first.
"""

import argparse
import contextlib
import select
import socket
import subprocess
import sys
from types import TracebackType
from typing import Final, Protocol, TypeVar

import msgspec

from edge_runtime.controller import Controller
from edge_runtime.errors import ConfigError
from edge_runtime.log_flags import make_log_plan
from edge_runtime.log_schema import End, Inputs, Observation, StageTimes, Tick
from edge_runtime.log_start import make_start, objective_set
from edge_runtime.log_wire import PACKET_BYTES, LogPlan, LogReport, Packet, decode_report, encode_packet
from edge_runtime.messages import Command, GuidedAction, TeamState
from edge_runtime.mission import Mission
from edge_runtime.plan import Plan
from edge_runtime.rate import DeadlineGrid, TimingRecord
from edge_runtime.weights import Array

BUFFER_BYTES: Final = 1 << 22
"""Asked of the system for the socket; at the usual limit, `net.core.wmem_max`, it holds about 180 ticks."""
OPENING_S: Final = 30.0
CLOSING_S: Final = 5.0

Self = TypeVar("Self", bound="Recorder")


class Record(Protocol):
    """Who keeps a run's record."""

    def begin(
        self,
        mission: Mission,
        controller: Controller,
        grid: DeadlineGrid,
        timing: TimingRecord,
        *,
        bridge: str,
        dry_run: bool,
    ) -> None:
        """Say what the run is about, and whose ticks follow."""
        ...

    def follow(
        self,
        deadline_s: float,
        team: TeamState,
        observation: Array,
        guided: GuidedAction,
        command: Command,
    ) -> None:
        """Keep one tick, after its command is out. Never blocks."""
        ...

    def end(self, stop_reason: str, *, failed: bool) -> LogReport | None:
        """Say why the run ended, once the robot is stopped; returns what became of the record, if any."""
        ...


class Unrecorded:
    """Nobody."""

    def begin(
        self,
        mission: Mission,
        controller: Controller,
        grid: DeadlineGrid,
        timing: TimingRecord,
        *,
        bridge: str,
        dry_run: bool,
    ) -> None:
        """Keep nothing."""

    def follow(
        self,
        deadline_s: float,
        team: TeamState,
        observation: Array,
        guided: GuidedAction,
        command: Command,
    ) -> None:
        """Keep nothing."""

    def end(self, stop_reason: str, *, failed: bool) -> None:
        """Return nothing."""


def open_record(flags: argparse.Namespace) -> contextlib.AbstractContextManager[Record]:
    """Return the record that edge-run's flags ask for, to be entered.

    Raises:
        ConfigError: as `make_log_plan`.
    """
    return Recorder(make_log_plan(flags)) if flags.log else contextlib.nullcontext(Unrecorded())


class Recorder:
    """Records one run through a logger process, which it starts; a context manager.

    Start it before real-time scheduling is asked for: the logger is to stay an ordinary process.
    """

    def __init__(self, plan: LogPlan) -> None:
        self._plan = plan
        self._socket = socket.socket()
        self._number = self._lost = 0
        self._followed: Plan | None = None

    def __enter__(self: Self) -> Self:
        """Start the logger and wait until its first file is open.

        Raises:
            ConfigError: if there cannot be one, with the system's reason.
        """
        self._socket.close()
        self._socket, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        with child:
            self._process = _start_logger(self._plan, child)
        report = self._await_report(OPENING_S)
        if report is None or report.failure:
            self._socket.close()
            self._process.wait()
            why = report.failure if report else f"{self._plan.folder}: the logger did not start"
            raise ConfigError(f"--log-dir {why}; choose another folder, or --no-log")
        self._socket.setblocking(False)
        self._path = report.path
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Let the logger finish by itself."""
        self._socket.close()

    def begin(
        self,
        mission: Mission,
        controller: Controller,
        grid: DeadlineGrid,
        timing: TimingRecord,
        *,
        bridge: str,
        dry_run: bool,
    ) -> None:
        """Say what the run is about, and whose ticks follow."""
        self._controller, self._grid, self._timing = controller, grid, timing
        self._previous = controller.command.action
        self._send(make_start(mission, controller, self._plan.run, bridge=bridge, dry_run=dry_run))

    def follow(
        self,
        deadline_s: float,
        team: TeamState,
        observation: Array,
        guided: GuidedAction,
        command: Command,
    ) -> None:
        """Hand over one tick, or count it as lost."""
        controller = self._controller
        plan = controller.plan
        if plan is not self._followed and self._send(objective_set(plan)):
            self._followed = plan
        inputs = Inputs(
            self._number, deadline_s, self._grid.misses, plan.version, controller.start, self._previous
        )
        seen = Observation(tuple(observation[0].tolist()))
        tick = Tick(inputs, team, seen, guided, command, StageTimes(*self._timing.laps))
        self._number += 1
        self._previous = command.action
        # A tick without its objectives could not be replayed.
        if self._followed is not plan or not self._send(tick):
            self._lost += 1

    def end(self, stop_reason: str, *, failed: bool) -> LogReport:
        """Let the logger finish, and return what became of the record."""
        self._socket.settimeout(CLOSING_S)
        self._send(End(stop_reason, failed, self._number, self._grid.misses, self._lost))
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        report = self._await_report(CLOSING_S)
        if report is None:
            failure = "the logger died or hangs; up to 1 s before its end is lost"
            return LogReport(self._path, 1, self._number - self._lost, self._lost, failure)
        return msgspec.structs.replace(report, lost=report.lost + self._lost)

    def _send(self, record: Packet) -> bool:
        try:
            self._socket.send(encode_packet(record))
        except OSError:
            return False
        return True

    def _await_report(self, longest_s: float) -> LogReport | None:
        ready, _, _ = select.select((self._socket,), (), (), longest_s)
        packet = b""
        with contextlib.suppress(OSError):
            packet = self._socket.recv(PACKET_BYTES) if ready else b""
        return decode_report(packet) if packet else None


def _start_logger(plan: LogPlan, child: socket.socket) -> "subprocess.Popen[bytes]":
    """Run the logger in its own session, so that the terminal's Ctrl-C reaches only the loop."""
    return subprocess.Popen(  # noqa: S603 - our own interpreter and module
        [
            sys.executable,
            "-m",
            "edge_runtime.logger",
            str(child.fileno()),
            msgspec.json.encode(plan).decode(),
        ],
        pass_fds=(child.fileno(),),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,  # who reads the loop's output must not wait for a logger that hangs
        start_new_session=True,
    )
