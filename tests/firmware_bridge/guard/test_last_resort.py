"""Whatever a link's library raises, and wherever: the robot is stopped, and one line says what happened."""

import errno
import itertools
import socket
import threading
import time

import msgspec
import pytest
from can_peers import Chassis, multicast_address, patient_spec
from guard_fakes import FakeLink, spec
from waiting import HANG_S

import firmware_bridge.guard.process as guard_module
from edge_runtime.errors import BridgeError
from firmware_bridge.guard import last_resort
from firmware_bridge.guard.last_resort import describe, stop_anyhow
from firmware_bridge.guard.link import Condition, Setpoint
from firmware_bridge.guard.process import main, make_link, serve
from firmware_bridge.guard.wire import Event, Phase, decode_answer, encode_command

FOREIGN = (
    ValueError("invalid literal\nfor int(): '\x1b[2J'"),
    KeyError("page 3"),
    OSError(errno.EHOSTUNREACH, "No route to host"),
    SystemExit(3),
)
CALLS = ("receive", "health", "state", "dropped", "send", "keepalive")


class BrokenLink(FakeLink):
    """A link that works until ``error`` is set; from then on one of its calls raises it."""

    def __init__(self, call="", **traits) -> None:
        super().__init__(keepalive_period_s=0.005, **traits)
        self.bus, self._end = socket.socketpair()
        self.stop_delay_s = 0.005
        self.call, self.error = call, None

    def __getattribute__(self, name):
        if name == object.__getattribute__(self, "__dict__").get("call") and self.error is not None:
            raise self.error
        return super().__getattribute__(name)

    def filenos(self):
        return (self._end.fileno(),)

    def receive(self, now_s) -> None:
        self._end.recv(1)


class Runtime:
    """The other end of a guard that serves in a thread."""

    def __init__(self, link, settings) -> None:
        self.socket, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        end.setblocking(False)
        self.socket.settimeout(HANG_S)
        wake, self._signals = socket.socketpair()
        self.failure: BaseException | None = None
        self._sequence = itertools.count()
        self._thread = threading.Thread(target=self._serve, args=(link, settings, end, wake))
        self._thread.start()

    def _serve(self, *arguments) -> None:
        try:
            serve(*arguments)
        except BaseException as error:  # noqa: BLE001 - judged by the test
            self.failure = error

    def command(self) -> None:
        now_s = time.monotonic()
        self.socket.send(encode_command(Setpoint(next(self._sequence), now_s, (0.0, 0.0), (0.5, 0.0))))

    def await_phase(self, phase) -> Event:
        while True:
            answer = decode_answer(self.socket.recv(512))
            if isinstance(answer, Event) and answer.phase is phase:
                return answer

    def join(self) -> str:
        self._thread.join(HANG_S)
        assert not self._thread.is_alive()
        assert type(self.failure) is BridgeError
        return str(self.failure)


@pytest.fixture
def drive():
    """A guard that drives a robot which is enabled already, and its runtime."""

    def drive(link, **changes):
        runtime = Runtime(link, spec(arm=False, deadline_s=HANG_S, **changes))
        runtime.command()
        runtime.await_phase(Phase.DRIVING)
        return runtime

    return drive


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("error", FOREIGN, ids=lambda error: type(error).__name__)
def test_whatever_is_raised_in_any_call_stops_the_robot_and_is_told_in_a_line(drive, call, error):
    link = BrokenLink(call)
    runtime = drive(link)
    link.error = error
    runtime.command()
    link.bus.send(b"x")
    told = runtime.await_phase(Phase.FAILED).text
    assert runtime.join() == told
    assert link.log[-2:] == ["stop 1", "stop 2"]
    assert told.startswith(f"the guard failed, {type(error).__name__} in test_last_resort.py, line ")
    assert told.isprintable()


def test_an_error_of_the_family_speaks_for_itself(drive):
    link = BrokenLink("health")
    runtime = drive(link)
    link.error = BridgeError("the port is gone")
    runtime.command()
    assert runtime.await_phase(Phase.FAILED).text == runtime.join() == "the port is gone"
    assert link.log[-2:] == ["stop 1", "stop 2"]


def test_a_robot_that_was_never_touched_is_left_alone():
    link = BrokenLink("receive")
    runtime = Runtime(link, spec())
    runtime.await_phase(Phase.WATCHING)
    link.error = FOREIGN[0]
    link.bus.send(b"x")
    runtime.await_phase(Phase.FAILED)
    runtime.join()
    assert not {"stop 1", "stop 2"} & set(map(str, link.log))


def test_a_robot_that_its_operator_has_is_left_alone(drive):
    link = BrokenLink("dropped")
    runtime = drive(link)
    link.condition = Condition.OVERRIDE
    link.error = FOREIGN[1]
    runtime.command()
    runtime.join()
    assert "stop 1" not in link.log


def test_a_stop_that_fails_is_begun_anew(drive):
    link = BrokenLink("send")
    failures = iter([FOREIGN[0], FOREIGN[1]])
    original = link.stop_sequence

    def stop_sequence():
        for error in failures:
            link.log.append("stop failed")
            raise error
        yield from original()

    link.stop_sequence = stop_sequence
    runtime = drive(link)
    link.error = FOREIGN[2]
    runtime.command()
    assert runtime.join() == runtime.await_phase(Phase.FAILED).text
    assert link.log[-4:] == ["stop failed", "stop failed", "stop 1", "stop 2"]


def test_a_stop_that_never_works_is_told_too(drive):
    link = BrokenLink("stop_sequence")
    runtime = drive(link)
    link.error = FOREIGN[1]
    runtime.socket.close()  # the guard begins to stop by itself, and fails
    place = r"KeyError in test_last_resort.py, line \d+: 'page 3'"
    with pytest.raises(BridgeError, match=rf"^the guard failed, {place}; stop sequence failed: .*{place}$"):
        raise BridgeError(runtime.join())


def test_a_stop_without_an_end_is_given_up(monkeypatch):
    monkeypatch.setattr(last_resort, "LONGEST_S", 0.05)
    link = FakeLink()
    link.stop_sequence = lambda: itertools.repeat(1e-3)
    assert stop_anyhow(link) == "stop sequence not done after 0.05 s"
    link.stop_sequence = lambda: itertools.repeat(3600.0)
    assert stop_anyhow(link) == "stop sequence not done after 0.05 s"


@pytest.mark.parametrize("answers", [True, False])
def test_a_stop_hears_what_the_robot_answers_meanwhile(answers):
    link, heard, begin_s = BrokenLink(), [], time.monotonic()
    link.receive = heard.append
    if answers:
        link.bus.send(b"x")
    assert stop_anyhow(link) == ""
    assert bool(heard) == answers
    assert all(begin_s <= now_s <= time.monotonic() for now_s in heard)


def test_the_place_is_the_innermost_line():
    def outer():
        middle()

    def middle():
        inner()

    def inner():
        raise KeyError

    with pytest.raises(KeyError) as caught:
        outer()
    line = inner.__code__.co_firstlineno + 1
    assert describe(caught.value) == f"the guard failed, KeyError in test_last_resort.py, line {line}"


def test_an_exception_that_was_never_raised_has_no_place():
    assert describe(KeyError()) == "the guard failed, KeyError in an unknown place"


@pytest.mark.parametrize("layer", ["receive", "send", "encode"])
def test_the_stop_sequence_is_on_a_real_wire(layer, monkeypatch):
    """Frames, brake and standby reach the chassis although reading, writing or encoding raised."""
    address = multicast_address()
    link = make_link(patient_spec(address))
    broken = link._codec if layer == "encode" else link._transport
    with Chassis(address) as chassis:
        link.open()
        runtime = Runtime(link, patient_spec(address))
        while chassis.data(0x111)[-5:] != [bytes.fromhex("01f4000000000000")] * 5:
            runtime.command()
            time.sleep(0.02)

        def fail(*_):
            monkeypatch.undo()  # once: the wire itself still works
            raise KeyError(layer)

        monkeypatch.setattr(broken, layer, fail)
        runtime.command()
        assert f": '{layer}'" in runtime.join()
        chassis.settle()
        assert chassis.frames[-2:] == [(0x131, b"\1" + bytes(7)), (0x421, bytes(8))]
        link.close()


class Unopened(FakeLink):
    def open(self):
        raise ZeroDivisionError("factor 0")

    def close(self):
        raise OSError("gone")


def test_what_is_raised_at_the_start_is_told_to_the_runtime(monkeypatch):
    monkeypatch.setattr(guard_module, "make_link", lambda _: Unopened())
    runtime, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with runtime:
        assert main([str(child.detach()), msgspec.json.encode(spec()).decode()]) == 2
        told = decode_answer(runtime.recv(512))
    assert told.phase is Phase.FAILED
    assert told.text.startswith("the guard failed, ZeroDivisionError in test_last_resort.py, line ")
    assert told.text.endswith(": factor 0")
