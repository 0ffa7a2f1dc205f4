"""The runtime's side of the socket, against a guard that the test plays."""

import socket
import subprocess
import sys
from types import SimpleNamespace

import pytest
from guard_fakes import spec
from msgspec.structs import replace
from waiting import HANG_S

import firmware_bridge.guard.guarded_bridge as bridge_module
from edge_runtime.control.bridge import Reaction
from edge_runtime.errors import BridgeError
from edge_runtime.messages import Command, RobotState
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.link import Setpoint
from firmware_bridge.guard.wire import (
    Complaint,
    Counts,
    Event,
    Phase,
    Report,
    StopRequest,
    decode_request,
    encode_event,
    encode_report,
)

COMMAND = Command(1, 5, 6.0, (0.1, 0.2), (0.3, 0.4))
STATE = RobotState(1, 2.0, (3.0, 4.0), (5.0, 6.0), 7.0)


class Played:
    """A guard whose process only sleeps; the test speaks for it on a duplicate of its socket."""

    def __init__(self) -> None:
        self.socket: socket.socket | None = None
        self.opening = [Event(Phase.WATCHING, "open")]
        self.lifetime = "pass"

    def start(self, module, asked) -> "tuple[socket.socket, subprocess.Popen[bytes]]":
        assert (module, asked) == ("firmware_bridge.guard.process", spec())
        ours, self.socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for event in self.opening:
            self.tell(event)
        if not self.opening:
            self.socket.close()
        return ours, subprocess.Popen([sys.executable, "-c", self.lifetime])

    def tell(self, event) -> None:
        encode = encode_report if isinstance(event, Report) else encode_event
        self.socket.send(encode(event, 1.0))

    def heard(self):
        return decode_request(self.socket.recv(512))


@pytest.fixture
def guard(monkeypatch):
    played = Played()
    monkeypatch.setattr(bridge_module, "start_child", played.start)
    monkeypatch.setattr(bridge_module, "ENDING_S", HANG_S)  # Python may take long to start, and to end
    monkeypatch.setattr(bridge_module, "STOPPING_S", HANG_S)
    yield played
    if played.socket is not None:
        played.socket.close()


@pytest.fixture
def bridge(guard):  # noqa: ARG001  # what it talks to
    with GuardedBridge(spec()) as opened:
        yield opened


def test_commands_go_to_the_guard_once(bridge, guard):
    bridge.write(COMMAND)
    assert guard.heard() == Setpoint(5, 6.0, (0.1, 0.2), (0.3, 0.4))
    guard.socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        guard.socket.recv(512)


def test_states_and_counts_come_back(bridge, guard):
    assert bridge.name == "can"
    assert bridge.read() is None
    guard.tell(Report(Phase.DRIVING, Counts(1, 2, 3, 4, 5), STATE))
    assert bridge.reaction == Reaction(spec().deadline_s, None, None)
    guard.tell(Report(Phase.DRIVING, Counts(6, 2, 3, 4, 5), None, 0.5))
    assert bridge.read() == STATE
    assert bridge.reaction == Reaction(spec().deadline_s, 0.5, None)
    assert bridge.counts == Counts(6, 2, 3, 4, 5)
    assert bridge.phase is Phase.DRIVING


def test_the_stamps_of_new_states_are_told_once_each(bridge, guard):
    poses = bridge.poses
    assert poses.fileno() == bridge._socket.fileno()
    assert poses.new_poses() == ()
    for stamp_s in (STATE.stamp_s, STATE.stamp_s, STATE.stamp_s + 0.5):
        guard.tell(Report(Phase.DRIVING, Counts(), replace(STATE, stamp_s=stamp_s)))
    assert poses.new_poses() == (STATE.stamp_s, STATE.stamp_s + 0.5)
    assert poses.new_poses() == ()
    assert bridge.read().stamp_s == STATE.stamp_s + 0.5


@pytest.mark.parametrize(
    ("arm", "phase", "said"),
    [
        (False, Phase.WATCHING, "nobody armed it, and --arm is not given"),
        (True, Phase.WATCHING, "the guard waits for the firmware before it arms"),
        (True, Phase.ENABLING, "the guard arms the robot"),
        (True, Phase.RECOVERING, "the guard arms the robot again"),
        (True, Phase.DRIVING, ""),
        (False, Phase.DRIVING, ""),
    ],
)
def test_why_commands_do_not_drive_the_robot(arm, phase, said):
    bridge = GuardedBridge(spec(arm=arm))
    bridge.phase = phase
    assert bridge.withholds == said


def test_complaints_are_kept_in_order(bridge, guard):
    guard.tell(Report(Phase.DRIVING, Counts(), STATE))
    guard.tell(Complaint("battery low"))
    guard.tell(Complaint("remote control lost"))
    assert bridge.read() == STATE
    assert bridge.complaints == ("battery low", "remote control lost")
    assert bridge.phase is Phase.DRIVING


def test_a_stop_of_the_guard_is_an_error_with_its_first_cause(bridge, guard):
    guard.tell(Event(Phase.STOPPING, "the cause"))
    guard.tell(Event(Phase.STOPPED, "stop sequence done"))
    with pytest.raises(BridgeError, match="the guard stopped the robot: the cause"):
        bridge.write(COMMAND)


def test_a_guard_that_ended_is_an_error(bridge, guard):
    guard.socket.close()
    with pytest.raises(BridgeError, match=r"^the guard ended: exit code 0$"):
        bridge.write(COMMAND)


@pytest.mark.parametrize(
    ("lifetime", "ending"),
    [
        ("raise SystemExit(7)", r"exit code 7"),
        ("import os; os.kill(os.getpid(), 9)", r"signal 9 \(Killed\)"),
        ("import time; time.sleep(3600)", "its socket closed"),
    ],
)
def test_a_guard_without_words_is_seen_to_end(guard, monkeypatch, lifetime, ending):
    monkeypatch.setattr(bridge_module, "ENDING_S", 0.05 if "sleep" in lifetime else HANG_S)
    guard.lifetime = lifetime
    with GuardedBridge(spec()) as bridge:
        guard.socket.close()
        with pytest.raises(BridgeError, match=f"^the guard ended: {ending}$"):
            bridge.write(COMMAND)
        bridge._process.kill()


def test_a_guard_that_dies_with_words_unread_is_quoted(bridge, guard):
    guard.tell(Event(Phase.STOPPING, "the cause"))
    guard.socket.close()
    with pytest.raises(BridgeError, match="the cause"):
        bridge.write(COMMAND)


def test_a_guard_that_does_not_read_never_blocks_the_runtime(bridge):
    with pytest.raises(BridgeError, match=r"^the guard does not take commands: is it stopped or starved\?$"):
        for _ in range(100_000):
            bridge.write(COMMAND)


def test_stop_waits_for_the_end_of_the_sequence(bridge, guard):
    guard.tell(Event(Phase.DRIVING, "enabled"))
    guard.tell(Event(Phase.STOPPING, "ordered"))
    guard.tell(Event(Phase.STOPPED, "stop sequence done"))
    bridge.stop("ordered")
    assert bridge.phase is Phase.STOPPED


def test_stop_asks_a_driving_guard(bridge, guard, monkeypatch):
    monkeypatch.setattr(bridge_module, "STOPPING_S", 0.05)
    with pytest.raises(BridgeError, match=r"did not finish the stop sequence within 0.05 s"):
        bridge.stop("ordered")
    monkeypatch.undo()
    assert guard.heard() == StopRequest("ordered")


def test_a_guard_that_is_stopping_is_not_asked_again_and_takes_no_commands(bridge, guard, monkeypatch):
    guard.tell(Event(Phase.STOPPING, "ordered"))
    with pytest.raises(BridgeError, match=r"^the guard stopped the robot: ordered$"):
        bridge.write(COMMAND)
    assert guard.heard() == Setpoint(5, 6.0, (0.1, 0.2), (0.3, 0.4))
    monkeypatch.setattr(bridge_module, "STOPPING_S", 0.05)
    with pytest.raises(BridgeError, match="did not finish the stop sequence"):
        bridge.stop("again")
    monkeypatch.undo()
    guard.socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        guard.heard()


def test_stop_without_a_guard_is_an_error(bridge, guard):
    guard.socket.close()
    bridge.read()
    with pytest.raises(BridgeError, match="the guard ended"):
        bridge.stop("ordered")


def test_a_guard_that_ends_within_its_stop_sequence_is_quoted(bridge, guard):
    guard.tell(Event(Phase.STOPPING, "the cause"))
    guard.socket.close()
    with pytest.raises(BridgeError, match=r"^the guard ended: the cause$"):
        bridge.stop("ordered")


def test_a_guard_that_dies_with_commands_unread_resets_the_connection(bridge, guard):
    bridge.write(COMMAND)
    guard.socket.close()
    assert bridge.read() is None
    with pytest.raises(BridgeError):
        bridge.stop("ordered")


def test_a_guard_that_cannot_start_is_told(guard):
    guard.opening = [Event(Phase.FAILED, "no such bus")]
    with pytest.raises(BridgeError, match=r"^no such bus$"), GuardedBridge(spec()):
        pass


def test_a_guard_that_dies_at_once_is_told(guard):
    guard.opening = []
    with (
        pytest.raises(BridgeError, match=r"^the guard ended: exit code 0$"),
        GuardedBridge(spec()),
    ):
        pass


def test_a_guard_that_does_not_open_is_told(guard, monkeypatch):
    monkeypatch.setattr(bridge_module, "OPENING_S", 0.05)
    guard.opening = [Report(Phase.WATCHING, Counts(), None)]
    told = r"^the guard did not open its link within 0\.05 s$"
    with pytest.raises(BridgeError, match=told), GuardedBridge(spec()):
        pass


def test_a_guard_has_all_of_its_time_to_open(guard, monkeypatch):  # noqa: ARG001
    monkeypatch.setattr(bridge_module, "OPENING_S", 0.9)
    monkeypatch.setattr(bridge_module, "time", SimpleNamespace(monotonic=lambda: 100.0))
    with GuardedBridge(spec()) as opened:
        assert opened.phase is Phase.WATCHING


def test_a_guard_that_does_not_end_is_told(guard, monkeypatch):
    monkeypatch.setattr(bridge_module, "STOPPING_S", 0.05)
    guard.lifetime = "import time; time.sleep(3600)"
    with pytest.raises(BridgeError, match="did not end within"), GuardedBridge(spec()) as opened:
        pid = opened.guard_pid
    assert pid > 0
    opened._process.kill()
    opened._process.wait(HANG_S)


def test_a_bridge_that_was_never_opened():
    bridge = GuardedBridge(spec())
    assert bridge.max_speed_m_s == spec().limits.speed_m_s
    assert (bridge.phase, bridge.counts) == (Phase.WATCHING, Counts())
    with pytest.raises(BridgeError, match="with statement"):
        _ = bridge.guard_pid
    bridge.__exit__(None, None, None)


def test_a_guard_that_failed_while_it_drove_is_quoted(bridge, guard):
    guard.tell(Event(Phase.DRIVING, "enabled"))
    guard.tell(Event(Phase.FAILED, "the guard failed, KeyError in slcan.py, line 7: 'x'"))
    with pytest.raises(BridgeError, match=r"^the guard stopped the robot: the guard failed, KeyError"):
        bridge.write(COMMAND)
