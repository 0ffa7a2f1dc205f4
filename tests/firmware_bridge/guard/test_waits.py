"""How the guard's loop waits, whom it listens to, and how often it tells the same."""

import contextlib
import os
import socket
import threading
import time
from types import SimpleNamespace

import msgspec
import pytest
from guard_fakes import FakeLink, spec
from waiting import HANG_S

import firmware_bridge.guard.process as guard_module
from edge_runtime.messages import RobotState
from firmware_bridge.guard.core import Guard
from firmware_bridge.guard.link import Setpoint
from firmware_bridge.guard.process import LONGEST_WAIT_S, Loop, main, serve
from firmware_bridge.guard.wire import Event, Phase, Report, decode_answer, encode_command

DEADLINE_S = 50.0
"""A busy machine does not let it pass; shorter than the longest wait, so that it shows in one."""


class QuietLink(FakeLink):
    """A fake link that hears nothing unless the test writes to ``bus``."""

    def __init__(self, **arguments) -> None:
        super().__init__(**arguments)
        self.bus, self._end = socket.socketpair()
        self.received: list[object] = []

    def filenos(self):
        return (self._end.fileno(),)

    def receive(self, now_s):
        self._end.recv(1)
        self.received.append(now_s)


class Runtime:
    """The other end of a guard that serves in a thread."""

    def __init__(self, link, **changes) -> None:
        self.socket, self.guards_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.guards_end.setblocking(False)
        self.socket.settimeout(HANG_S)
        self._wake, self._signals = socket.socketpair()
        self.failure: Exception | None = None
        settings = spec(arm=False, **{"deadline_s": DEADLINE_S, **changes})
        self._thread = threading.Thread(target=self._serve, args=(link, settings))
        self._thread.start()

    def _serve(self, link, settings) -> None:
        try:
            serve(link, settings, self.guards_end, self._wake)
        except Exception as error:  # noqa: BLE001  # judged by the test
            self.failure = error

    def drive(self) -> None:
        """Give one command, and wait until the guard drives."""
        self.socket.send(encode_command(Setpoint(0, time.monotonic(), (0.0, 0.0), (0.5, 0.0))))
        self.events_until(Phase.DRIVING)

    def answers(self):
        while packet := self.socket.recv(512):
            yield decode_answer(packet)

    def events_until(self, phase) -> list[Event]:
        events = []
        for answer in self.answers():
            if isinstance(answer, Event):
                events.append(answer)
                if answer.phase is phase:
                    break
        return events

    def end(self) -> None:
        self.socket.close()
        self._thread.join(HANG_S)
        assert not self._thread.is_alive()


@pytest.fixture
def waits(monkeypatch):
    """The sources and the longest time of each wait of the loop."""
    made = []

    def select(sources, _writers, _exceptions, longest_s):
        made.append((list(sources), longest_s))
        return real(sources, (), (), longest_s)

    real = guard_module.select.select
    monkeypatch.setattr(guard_module, "select", SimpleNamespace(select=select))
    return made


def test_waits_no_longer_than_the_deadline(waits):
    runtime = Runtime(QuietLink())
    runtime.drive()
    runtime.end()
    assert any(0.0 < longest_s <= DEADLINE_S < LONGEST_WAIT_S for _, longest_s in waits)


def test_a_runtime_that_says_goodbye_is_told_why_and_listened_to_no_more(waits):
    runtime = Runtime(QuietLink())
    runtime.drive()
    before = len(waits)
    runtime.socket.shutdown(socket.SHUT_WR)
    events = runtime.events_until(Phase.STOPPED)
    number = runtime.guards_end.fileno()
    runtime.end()
    assert [event.text for event in events] == ["the runtime's socket closed", "stop sequence done"]
    listening = [number in sources for sources, _ in waits[before:]]
    assert not any(listening[1:])


def test_what_has_not_changed_is_not_told_again():
    runtime = Runtime(link := QuietLink(keepalive_period_s=0.005))
    while len(link.log) < 30:
        time.sleep(0.01)
    runtime.socket.shutdown(socket.SHUT_WR)
    reports = [answer for answer in _drain(runtime) if isinstance(answer, Report)]
    runtime.end()
    assert [report.phase for report in reports] == [Phase.WATCHING, Phase.STOPPED]


def test_counts_alone_are_told_now_and_then(monkeypatch):
    runtime, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    guard = Guard(link := FakeLink(), spec(arm=False))
    loop, told = Loop(guard, end, end), []
    for now_s in (100.0, 100.02, 100.04, 100.11, 100.12):
        monkeypatch.setattr(guard_module.time, "monotonic", lambda now_s=now_s: now_s)
        guard.on_packet(encode_command(Setpoint(int(1e3 * now_s), now_s, (0.0, 0.0), (0.5, 0.0))), now_s)
        if now_s == 100.12:
            link.newest = RobotState(1, now_s, (3.0, 4.0), (5.0, 6.0), 7.0)
        guard.events.clear()
        loop._tell()
        runtime.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            told.append((now_s, decode_answer(runtime.recv(512)).counts.forwarded))
    assert told == [(100.0, 1), (100.11, 4), (100.12, 5)]


def _drain(runtime):
    for answer in runtime.answers():
        yield answer
        if isinstance(answer, Report) and answer.phase is Phase.STOPPED:
            return


def test_feedback_is_taken_in_with_its_time():
    runtime = Runtime(link := QuietLink())
    link.bus.send(b"x")
    while not link.received:
        time.sleep(0.01)
    runtime.end()
    assert runtime.failure is None
    assert abs(link.received[0] - time.monotonic()) < 20.0


def test_an_unsafe_firmware_timeout_is_allowed_by_its_flag_only():
    for allowed in (True, False):
        link = QuietLink()
        link.firmware_timeout_s = None
        runtime = Runtime(link, allow_unsafe_firmware_timeout=allowed)
        runtime.end()
        assert (runtime.failure is None) is allowed


def test_the_process_makes_its_link_from_its_specification_and_leaves_no_child_the_socket(monkeypatch):
    made = []

    def make_link(settings):
        made.append((settings, os.get_inheritable(descriptor)))
        return QuietLink()

    monkeypatch.setattr(guard_module, "make_link", make_link)
    runtime, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    descriptor = end.detach()
    os.set_inheritable(descriptor, True)
    runtime.shutdown(socket.SHUT_WR)
    assert main([str(descriptor), msgspec.json.encode(spec()).decode()]) == 0
    runtime.close()
    assert made == [(spec(), False)]
