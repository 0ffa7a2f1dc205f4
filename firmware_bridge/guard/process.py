"""The guard process: owns the bus, forwards only fresh commands, stops the robot when they end.

``python -m firmware_bridge.guard.process FD SPEC``: FD is its end of a SOCK_SEQPACKET pair whose other
end the runtime holds, SPEC a GuardSpec in JSON. One thread, one loop: wait for the runtime, the bus, a
signal or the next deadline; act; report. It ends when the socket closes or on SIGTERM, SIGINT or SIGHUP,
after the stop sequence; kill -9 leaves the robot to the firmware's own timeout, which was checked at the
start.
"""

import contextlib
import gc
import importlib
import math
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Iterator

import msgspec

from edge_runtime.errors import BridgeError
from edge_runtime.run.bridges import BRIDGES
from firmware_bridge.guard.core import Guard, check_firmware_timeout
from firmware_bridge.guard.last_resort import describe, stop_anyhow
from firmware_bridge.guard.link import Condition, Link
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.guard.wire import (
    PACKET_BYTES,
    Event,
    Phase,
    Report,
    encode_event,
    encode_report,
)

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
LONGEST_WAIT_S = 60.0
COUNTS_S = 0.1
"""Between two reports of which only the counts are new."""


class Loop:
    """Waits for what concerns the guard and tells it."""

    def __init__(self, guard: Guard, runtime: socket.socket, wake: socket.socket) -> None:
        self._guard = guard
        self._runtime = runtime
        self._wake = wake
        self._runtime_fd, self._wake_fd = runtime.fileno(), wake.fileno()
        self._heard: tuple[int, ...] = (self._wake_fd, self._runtime_fd)
        self._told: Report | None = None
        self._told_s = -math.inf

    def run(self) -> None:
        """Serve until the guard has finished."""
        self._tell()
        while not self._guard.finished:
            readable = self._wait()
            if self._runtime_fd in readable:
                self._read_runtime()
            if self._wake_fd in readable:
                name = signal.Signals(self._wake.recv(1)[0]).name
                self._guard.on_leave(f"the guard received {name}", time.monotonic())
            if not readable.isdisjoint(self._guard.filenos):
                self._guard.on_feedback(time.monotonic())
            self._guard.on_time(time.monotonic())
            self._tell()

    def _wait(self) -> set[int]:
        sources = (*self._heard, *self._guard.filenos)
        wait_s = self._guard.next_due_s() - time.monotonic()
        readable, _, _ = select.select(sources, (), (), min(max(wait_s, 0.0), LONGEST_WAIT_S))
        return set(readable)

    def _read_runtime(self) -> None:
        """Take one packet: then the bus gets its turn."""
        try:
            packet = self._runtime.recv(PACKET_BYTES)
        except OSError:
            packet = b""
        if packet:
            self._guard.on_packet(packet, time.monotonic())
        else:
            self._heard = (self._wake_fd,)
            self._guard.on_leave("the runtime's socket closed", time.monotonic())

    def _tell(self) -> None:
        """Send events, then the report if it changed; a full socket keeps events for the next pass."""
        now_s = time.monotonic()
        while self._guard.events and self._send(encode_event(self._guard.events[0], now_s)):
            self._guard.events.popleft()
        report = self._guard.report()
        if self._is_news(report, now_s) and self._send(encode_report(report, now_s)):
            self._told, self._told_s = report, now_s

    def _is_news(self, report: Report, now_s: float) -> bool:
        told = self._told
        if told is None or report.state != told.state or report.phase is not told.phase:
            return True
        return report != told and now_s - self._told_s >= COUNTS_S

    def _send(self, packet: bytes) -> bool:
        try:
            self._runtime.send(packet)
        except BlockingIOError:
            return False
        except OSError:
            return True  # Nobody is left to tell; the read side notices and stops the robot.
        return True


def serve(link: Link, spec: GuardSpec, runtime: socket.socket, wake: socket.socket) -> None:
    """Guard one opened link until the runtime leaves; whatever fails in here, the robot is told to stop.

    Raises:
        ConfigError: if the firmware's command timeout does not stop the robot after the guard's death.
        BridgeError: if anything failed that the guard does not answer by itself, once the robot was stopped.
    """
    check_firmware_timeout(link, spec.allow_unsafe_firmware_timeout)
    guard = Guard(link, spec)
    guard.events.append(Event(Phase.WATCHING, "open"))
    try:
        Loop(guard, runtime, wake).run()
    except BaseException as error:
        failure = describe(error)
        tell_failure(runtime, failure)
        trouble = stop_anyhow(link) if guard.holds_robot and not _is_taken(link) else ""
        raise BridgeError("; ".join(filter(None, (failure, trouble)))) from error


def _is_taken(link: Link) -> bool:
    """Whether an operator has the robot, as far as the link can still tell."""
    with contextlib.suppress(BaseException):
        return link.health(time.monotonic()).condition is Condition.OVERRIDE
    return False


def tell_failure(runtime: socket.socket, text: str) -> None:
    """Tell the runtime why this guard ends, if it still listens."""
    with contextlib.suppress(OSError):
        runtime.send(encode_event(Event(Phase.FAILED, text), time.monotonic()))


def make_link(spec: GuardSpec) -> Link:
    """Build the link that the specification names; nothing is opened yet."""
    module = importlib.import_module(BRIDGES[spec.link].guard_link)
    link: Link = module.make_link(spec)
    return link


@contextlib.contextmanager
def wake_on_signals() -> Iterator[socket.socket]:
    """Yield a socket on which each of SIGNALS arrives as one byte, its number."""
    wake, writer = socket.socketpair()
    writer.setblocking(False)
    previous = {number: signal.signal(number, lambda *_: None) for number in SIGNALS}
    descriptor = signal.set_wakeup_fd(writer.fileno())
    try:
        yield wake
    finally:
        signal.set_wakeup_fd(descriptor)
        for number, handler in previous.items():
            signal.signal(number, handler)
        wake.close()
        writer.close()


def guard(spec: GuardSpec, runtime: socket.socket) -> None:
    """Open the link, guard it, close it."""
    with wake_on_signals() as wake:
        link = make_link(spec)
        try:
            link.open()
            gc.freeze()
            serve(link, spec, runtime, wake)
        finally:
            with contextlib.suppress(BaseException):  # all is done; an adapter that is gone needs no farewell
                link.close()


def main(arguments: list[str]) -> int:
    """Run as the runtime's child; whatever is raised goes to the runtime in one line, which prints it."""
    runtime = socket.socket(fileno=int(arguments[0]))
    runtime.setblocking(False)
    os.set_inheritable(runtime.fileno(), False)
    try:
        spec = msgspec.json.decode(arguments[1], type=GuardSpec)
        guard(spec, runtime)
    except BaseException as error:  # noqa: BLE001 - told to the runtime, whose user reads it
        tell_failure(runtime, describe(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
