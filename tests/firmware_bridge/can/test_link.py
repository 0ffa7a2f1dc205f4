"""The link between codec and bus, on a bus in memory and a clock that the test turns."""

import pytest
from can_peers import guard_spec

import firmware_bridge.can.link as link_module
from edge_runtime.errors import BridgeError
from firmware_bridge.can.bus import CanBus
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.feedback import DeadReckoning, PlanarPose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.limo import LimoPort
from firmware_bridge.can.link import STOP_TRIES, CanLink, make_link
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.guard.link import Condition, Setpoint

READY = Frame(0x211, bytes([0, 1, 0, 0, 0, 0, 0, 0]))
OPERATOR = Frame(0x211, bytes([0, 3, 0, 0, 0, 0, 0, 0]))
MOVING = Frame(0x221, bytes.fromhex("01f4000000000000"))


class Wire:
    """A transport in memory."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []
        self.arriving: list[Frame] = []
        self.full = 0
        self.is_open = False
        self.heard = ()
        self.malformed = 0

    def open(self):
        self.is_open = True

    def close(self):
        self.is_open = False

    def hear_only(self, identifiers):
        assert self.is_open
        self.heard = identifiers

    def fileno(self):
        return 5

    def send(self, frame):
        if self.full:
            self.full -= 1
            return False
        self.sent.append(frame)
        return True

    def receive(self):
        arrived, self.arriving = self.arriving, []
        yield from arrived


class Rig:
    def __init__(self, name, monkeypatch) -> None:
        path = profile_path(name)
        profile = load_profile(path)
        self.wire, self.now = Wire(), 50.0
        robot = DeadReckoning(4, PlanarPose(), profile.base)
        self.link = CanLink(profile, CanCodec(profile, path), self.wire, robot)
        monkeypatch.setattr(link_module.time, "monotonic", lambda: self.now)

    def hear(self, *frames) -> None:
        self.wire.arriving = list(frames)
        self.link.receive(self.now)

    def command(self, velocity) -> None:
        self.link.send(Setpoint(0, self.now, (0.0, 0.0), velocity), self.now)

    def play(self, steps) -> list[float]:
        """Run a sequence to its end; returns its pauses."""
        pauses = []
        for pause in steps:
            pauses.append(pause)
            self.now += pause
        return pauses

    def speeds(self) -> list[int]:
        frames = [frame for frame in self.wire.sent if frame.frame_id == 0x111]
        return [int.from_bytes(frame.data[:2], "big", signed=True) for frame in frames]


@pytest.fixture
def rig(monkeypatch):
    return Rig("agilex_v2", monkeypatch)


@pytest.mark.parametrize(("name", "transport"), [("agilex_v2", CanBus), ("agilex_limo", LimoPort)])
def test_the_profile_names_the_transport(name, transport):
    link = make_link(guard_spec("can0", name))
    assert isinstance(link._transport, transport)


def test_opens_and_closes_its_transport(rig):
    rig.link.open()
    assert rig.wire.is_open
    assert rig.link.filenos() == (5,)
    assert rig.wire.heard == ((0x211, False), (0x221, False))
    rig.link.close()
    assert not rig.wire.is_open
    assert rig.link.firmware_timeout_s == 0.5
    assert rig.link.recoveries == 3


def test_feedback_becomes_state_and_health(rig):
    assert rig.link.state() is None
    assert rig.link.health(rig.now).condition is Condition.FAULT
    rig.hear(READY, Frame(0x7FF, b""), Frame(0x221, b"short"))
    assert rig.link.state() is None
    rig.hear(MOVING)
    rig.now += 0.02
    rig.hear(MOVING)
    assert rig.link.health(rig.now).condition is Condition.READY
    assert rig.link.state().robot_id == 4
    assert rig.link.state().position_m == pytest.approx((0.21, 0.0))
    assert rig.link.state().stamp_s == rig.now


def test_sends_each_setpoint_once_in_the_body_frame(rig):
    rig.command((0.5, 0.1))
    assert rig.wire.sent == [Frame(0x111, bytes.fromhex("01f4 01f4 0000 0000"))]
    rig.link.keepalive(True, rig.now)
    assert len(rig.wire.sent) == 1


def test_a_full_queue_drops_the_newest_and_counts(rig):
    rig.wire.full = 1
    rig.command((0.5, 0.0))
    rig.command((0.25, 0.0))
    assert rig.speeds() == [250]
    assert rig.link.dropped() == 1


def test_stops_with_a_ramp_zeros_brake_and_standby(rig):
    rig.hear(READY, MOVING)
    rig.command((0.1, 0.05))
    rig.wire.sent.clear()
    pauses = rig.play(rig.link.stop_sequence())
    assert rig.speeds() == [60, 20, 0, 0, 0]
    yaws = [frame.data[2:4].hex() for frame in rig.wire.sent[:2]]
    assert yaws == ["0096", "0032"]  # 0.25 rad/s shrinks with the speed: the curve stays
    assert [frame.frame_id for frame in rig.wire.sent[-2:]] == [0x131, 0x421]
    assert pauses == [0.02] * 7


def test_a_robot_at_rest_needs_no_ramp(rig):
    rig.play(rig.link.stop_sequence())
    assert rig.speeds() == [0, 0, 0]


def test_a_sudden_stop_where_the_profile_allows_it(monkeypatch):
    rig = Rig("agilex_limo", monkeypatch)
    rig.command((0.3, -0.4))
    rig.play(rig.link.stop_sequence())
    assert rig.speeds() == [300, 0, 0, 0]


def test_an_operator_ends_the_ramp(rig):
    rig.command((0.5, 0.0))
    steps = rig.link.stop_sequence()
    next(steps)
    rig.hear(OPERATOR)
    sent = len(rig.wire.sent)
    assert rig.play(steps) == []
    assert len(rig.wire.sent) == sent


def test_a_stop_insists_on_a_full_queue(rig):
    rig.wire.full = 3
    pauses = rig.play(rig.link.stop_sequence())
    assert rig.speeds() == [0, 0, 0]
    assert len(pauses) == 5 + 3
    assert rig.link.dropped() == 3


def test_a_queue_that_stays_full_does_not_hold_the_stop_for_ever(rig):
    rig.wire.full = 10**9
    assert len(rig.play(rig.link.stop_sequence())) == 5 * STOP_TRIES + 5


def test_enabling_waits_for_the_firmware(rig):
    steps = rig.link.enable_sequence()
    for _ in range(6):
        rig.now += next(steps)
    assert [frame.frame_id for frame in rig.wire.sent] == [0x111, 0x441, 0x421, 0x131]
    assert rig.wire.sent[0].data == bytes(8)
    rig.hear(READY, MOVING)
    assert list(steps) == []


def test_enabling_gives_up_with_the_reason(rig):
    steps = rig.link.enable_sequence()
    with pytest.raises(BridgeError, match="not enabled within 2 s: no SystemState received yet"):
        rig.play(steps)
    assert len(rig.wire.sent) == 4


def test_firmware_that_tells_no_mode_is_ready_only_once_enabled(monkeypatch):
    rig = Rig("vesc", monkeypatch)
    rig.hear(*(Frame(0x900 | node, bytes(8), extended=True) for node in (1, 2)))
    assert rig.link.health(rig.now).condition is Condition.WAITING
    assert "--arm" in rig.link.health(rig.now).detail
    rig.play(rig.link.enable_sequence())
    assert rig.link.health(rig.now).condition is Condition.READY
    rig.play(rig.link.stop_sequence())
    rig.hear(*(Frame(0x900 | node, bytes(8), extended=True) for node in (1, 2)))
    assert rig.link.health(rig.now).condition is Condition.WAITING
