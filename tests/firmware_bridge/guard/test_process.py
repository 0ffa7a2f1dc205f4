"""The guard's loop and start-up, in this process: the test is the runtime at the other end of the socket."""

import itertools
import os
import runpy
import signal
import socket
import sys
import threading
import time

import msgspec
import pytest
from guard_fakes import FakeLink, spec
from waiting import HANG_S

import firmware_bridge.guard.process as guard_module
from edge_runtime.messages import RobotState
from firmware_bridge.can.feedback import PlanarPose
from firmware_bridge.can.link import CanLink, CanOptions
from firmware_bridge.can.profile import profile_path
from firmware_bridge.guard.link import Setpoint
from firmware_bridge.guard.process import main
from firmware_bridge.guard.wire import Event, Phase, Report, decode_answer, encode_command, encode_stop


class PipeLink(FakeLink):
    """A fake link whose bus is a socket: what the test writes to ``bus`` makes the guard listen."""

    def __init__(self) -> None:
        super().__init__()
        self.bus, self._end = socket.socketpair()

    def filenos(self):
        return (self._end.fileno(),)

    def receive(self, now_s):
        self._end.recv(1)
        super().receive(now_s)

    def close(self):
        super().close()
        self.bus.close()
        self._end.close()


@pytest.fixture
def link(monkeypatch):
    made = PipeLink()
    monkeypatch.setattr(guard_module, "make_link", lambda _: made)
    return made


class Session:
    """Runs ``main`` in the main thread, where signals arrive, against a runtime in another."""

    def __init__(self, runtime_does, **changes) -> None:
        self.runtime, self._child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._child.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
        self.runtime.settimeout(HANG_S)
        self._encoded = msgspec.json.encode(spec(**changes)).decode()
        self._does = runtime_does
        self.answers: list[Report | Event] = []
        self.failure: Exception | None = None

    def run(self) -> int:
        thread = threading.Thread(target=self._play)
        thread.start()
        try:
            return main([str(self._child.detach()), self._encoded])
        finally:
            thread.join()
            self.runtime.close()
            if self.failure is not None:
                raise self.failure

    def _play(self) -> None:
        try:
            self._does(self)
        except Exception as error:  # noqa: BLE001  # raised again in the main thread
            self.failure = error
            self.runtime.close()

    def until(self, condition) -> None:
        while not (self.answers and condition(self.answers[-1])):
            self.answers.append(decode_answer(self.runtime.recv(512)))

    def phase(self, phase: Phase) -> None:
        self.until(lambda answer: answer.phase is phase)

    def command(self, sequence: int) -> None:
        self.runtime.send(encode_command(Setpoint(sequence, time.monotonic(), (0.0, 0.0), (0.5, 0.0))))

    def drive(self) -> None:
        """Command at 100 Hz until the guard drives."""
        self.phase(Phase.WATCHING)
        self.runtime.settimeout(0.01)
        for sequence in itertools.count():
            self.command(sequence)
            try:
                self.phase(Phase.DRIVING)
                break
            except TimeoutError:
                continue
        self.runtime.settimeout(HANG_S)

    def events(self) -> list[str]:
        return [answer.text for answer in self.answers if isinstance(answer, Event)]


def test_a_closed_socket_stops_the_robot(link):
    def runtime(session):
        session.drive()
        session.runtime.close()

    assert Session(runtime, deadline_s=HANG_S).run() == 0
    assert link.log[:3] == ["open", "enable 1", "enable 2"]
    assert link.log[-3:] == ["stop 1", "stop 2", "close"]
    assert all(entry[0] == "send" for entry in link.log[3:-3])


@pytest.mark.usefixtures("link")
def test_silence_stops_the_robot_while_the_socket_stays_open():
    def runtime(session):
        session.drive()
        session.phase(Phase.STOPPED)
        session.runtime.close()

    session = Session(runtime, deadline_s=0.5, arm=False)  # it drives from the first command on
    assert session.run() == 0
    assert session.events() == [
        "open",
        "already enabled",
        "no fresh command for 500 ms",
        "stop sequence done",
    ]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_stop_the_robot_and_end_the_guard(link, number):
    def runtime(session):
        session.drive()
        os.kill(os.getpid(), number)
        session.phase(Phase.STOPPED)

    session = Session(runtime, deadline_s=HANG_S)
    assert session.run() == 0
    assert session.events()[3:] == [f"the guard received {number.name}", "stop sequence done"]
    assert link.log[-3:] == ["stop 1", "stop 2", "close"]


@pytest.mark.usefixtures("link")
def test_signal_handlers_are_given_back():
    before = [signal.getsignal(number) for number in guard_module.SIGNALS]
    Session(lambda session: session.runtime.close()).run()
    assert [signal.getsignal(number) for number in guard_module.SIGNALS] == before


def test_reports_follow_the_bus(link):
    def runtime(session):
        session.phase(Phase.WATCHING)
        link.newest = RobotState(1, 2.0, (3.0, 4.0), (5.0, 6.0), 7.0)
        link.bus.send(b"x")
        session.until(lambda answer: isinstance(answer, Report) and answer.state is not None)
        session.runtime.close()

    session = Session(runtime)
    assert session.run() == 0
    assert session.answers[-1].state == link.newest
    assert "receive" in link.log


def test_packets_that_wait_are_all_judged_in_their_order(link):
    def runtime(session):
        session.drive()
        for sequence in range(10**6, 10**6 + 50):
            session.command(sequence)
        session.runtime.send(encode_stop("enough", time.monotonic()))
        session.phase(Phase.STOPPED)
        session.runtime.close()

    Session(runtime, deadline_s=HANG_S).run()
    sent = [entry[1] for entry in link.log if entry[0] == "send"]
    assert sent[-50:] == list(range(10**6, 10**6 + 50))


def test_a_runtime_that_does_not_listen_still_gets_every_event(link):
    def runtime(session):
        session.drive()
        for sequence in range(10**6, 10**6 + 100):  # Reports pile up unread until the socket is full.
            link.newest = RobotState(1, float(sequence), (3.0, 4.0), (0.0, 0.0), 7.0)
            session.command(sequence)
            time.sleep(0.001)
        session.runtime.send(encode_stop("enough", time.monotonic()))
        while "stop 2" not in link.log:
            time.sleep(0.01)
        session.until(lambda answer: isinstance(answer, Event) and answer.text == "stop sequence done")
        session.runtime.close()

    session = Session(runtime, deadline_s=HANG_S)
    assert session.run() == 0
    assert session.events()[3:] == ["enough", "stop sequence done"]


def test_a_link_that_does_not_open_is_told_to_the_runtime(link):
    link.failing = {"open"}
    session = Session(lambda session: session.phase(Phase.FAILED))
    assert session.run() == 2
    assert session.events() == ["open failed"]
    assert link.log == ["close"]


def test_an_unsafe_firmware_timeout_is_told_to_the_runtime(link):
    link.firmware_timeout_s = None
    session = Session(lambda session: session.phase(Phase.FAILED))
    assert session.run() == 2
    assert "--allow-unsafe-firmware-timeout" in session.events()[0]
    assert link.log == ["open", "close"]


def test_a_failure_that_nobody_hears_is_no_crash(link):
    link.failing = {"open"}
    runtime, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    runtime.close()
    assert main([str(child.detach()), msgspec.json.encode(spec()).decode()]) == 2


def test_a_wrong_specification_is_told_to_the_runtime():
    runtime, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with runtime:
        assert main([str(child.detach()), '{"link": "smoke"}']) == 2
        assert decode_answer(runtime.recv(512)).phase is Phase.FAILED


@pytest.mark.filterwarnings("ignore:.*found in sys.modules.*:RuntimeWarning")
def test_runs_as_a_module(monkeypatch):
    runtime, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    monkeypatch.setattr(sys, "argv", ["guard", str(child.detach()), "{}"])
    with runtime, pytest.raises(SystemExit) as ended:
        runpy.run_module("firmware_bridge.guard.process", run_name="__main__")
    assert ended.value.code == 2


def test_makes_the_link_that_the_specification_names():
    options = CanOptions("can0", str(profile_path("agilex_v2")), PlanarPose())
    made = guard_module.make_link(spec(options=msgspec.Raw(msgspec.json.encode(options))))
    assert isinstance(made, CanLink)
