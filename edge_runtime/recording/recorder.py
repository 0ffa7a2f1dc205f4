"""The loop's side of its log: hands each tick to the logger's process and never waits for it.

Handing over is sending the tick over a local socket, after the command is out; the system keeps what was
sent, also of a loop that is killed. A socket that is full, because the logger is held up, costs the newest
tick, which is counted. Why a process and not a thread: a thread's encoding holds the interpreter's lock at
moments of its own choosing, and longest where real-time scheduling lets something else run first.
"""

import argparse
import contextlib
import select
import socket
import time
from typing import Final, TypeVar

import msgspec

from edge_runtime.common.arrays import Array
from edge_runtime.common.child import start_child
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import Guide
from edge_runtime.messages import Command, GuidedAction, TeamState
from edge_runtime.recording.flags import make_log_plan
from edge_runtime.recording.schema import BundleIdentity, End
from edge_runtime.recording.start import identify, logged_set, make_start
from edge_runtime.recording.wire import (
    PACKET_BYTES,
    Complaint,
    LogPlan,
    LogReport,
    decode_report,
    encode_packet,
    pack_tick,
    tick_packet,
)

OPENING_S: Final = 30.0
CLOSING_S: Final = 5.0
SOCKET_BYTES: Final = 1 << 20
"""Asked for; where the system grants its usual 208 KiB, that is 180 ticks of a team of four."""

Self = TypeVar("Self", bound="Recorder")


def open_record(flags: argparse.Namespace) -> "contextlib.AbstractContextManager[Recorder | None]":
    """Return who keeps the record that edge-run's flags ask for, to be entered; nobody with ``--no-log``.

    Raises:
        ConfigError: as `make_log_plan`.
    """
    return Recorder(make_log_plan(flags)) if flags.log else contextlib.nullcontext()


class Recorder:
    """Records one run through a logger process, which it starts; a context manager.

    Start it before real-time scheduling is asked for: the logger is to stay an ordinary process.
    """

    def __init__(self, plan: LogPlan) -> None:
        self._plan = plan
        self._number = self._lost = 0
        self._followed: Guide | None = None
        self._bundle: BundleIdentity | None = None
        self._observation: Array | None = None
        self._packet = tick_packet()

    def __enter__(self: Self) -> Self:
        """Start the logger and wait until its first file is open.

        Raises:
            ConfigError: if there cannot be one, with the system's reason.
        """
        try:
            self._socket, self._process = start_child(
                "edge_runtime.recording.logger_process", self._plan, quiet=True
            )
        except OSError as error:
            raise ConfigError(f"no logger could be started ({error.strerror}); or --no-log") from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BYTES)
        report = self._await_report(OPENING_S)
        if report is None or report.failure:
            self._socket.close()
            self._process.wait()
            why = report.failure if report else f"{self._plan.folder}: the logger did not start"
            raise ConfigError(f"--log-dir {why}; choose another folder, or --no-log")
        self._path = report.path
        return self

    def __exit__(self, *_: object) -> None:
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
        start = make_start(mission, controller, self._plan.run, bridge=bridge, dry_run=dry_run)
        self._send(encode_packet(start))

    def take_over(self, mission: Mission, controller: Controller) -> None:
        """Take the ticks of another controller from now on; its policy is told with the objectives."""
        self._controller, self._followed, self._bundle = controller, None, identify(mission)

    def record(
        self,
        deadline_s: float,
        team: TeamState,
        observation: Array,
        guided: GuidedAction,
        command: Command,
    ) -> None:
        """Hand over one tick, or count it as lost."""
        controller, guide = self._controller, self._controller.guide
        if guide is not self._followed and self._send(encode_packet(logged_set(guide, self._bundle))):
            self._followed = guide
        if observation is not self._observation:  # its memory is used again and again
            self._observation, self._seen = observation, observation.data.cast("B")
        parts = (
            self._number,
            deadline_s,
            self._grid.misses,
            guide.version,
            controller.start,
            self._previous,
            controller.elapsed_s,
            team,
            self._seen,
            guided,
            command,
            self._timing.laps,
            controller.unfamiliar,
        )
        pack_tick(parts, self._packet)
        self._number += 1
        self._previous = command.action
        # A tick without its objectives could not be replayed.
        if self._followed is not guide or not self._send(self._packet):
            self._lost += 1

    def complain(self, text: str) -> None:
        """Hand over what the robot's firmware complains of; lost if there is no room."""
        self._send(encode_packet(Complaint(text)))

    def end(self, stop_reason: str, *, failed: bool) -> LogReport:
        """Let the logger finish, and return what became of the record."""
        last_s = time.monotonic() + CLOSING_S
        packet = encode_packet(End(stop_reason, failed, self._number, self._grid.misses, self._lost))
        while not self._send(packet) and self._process.poll() is None and time.monotonic() < last_s:
            time.sleep(0.01)
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        report = self._await_report(CLOSING_S)
        if report is None:
            failure = "the logger died or hangs; up to 1 s before its end is lost"
            return LogReport(self._path, 1, self._number - self._lost, self._lost, failure)
        return msgspec.structs.replace(report, lost=report.lost + self._lost)

    def _send(self, packet: bytes | bytearray) -> bool:
        """Hand over a packet; whether the socket, and so the logger, has it."""
        try:
            self._socket.send(packet)
        except OSError:  # full, or nobody's any more
            return False
        return True

    def _await_report(self, longest_s: float) -> LogReport | None:
        ready, _, _ = select.select((self._socket,), (), (), longest_s)
        packet = b""
        with contextlib.suppress(OSError):
            packet = self._socket.recv(PACKET_BYTES) if ready else b""
        return decode_report(packet) if packet else None
