"""VESCs that tell their timeout, answering as comm_can.c of the firmware does."""

import binascii
import struct
from collections import deque

import msgspec
import pytest
from clocks import simulate_waits

from edge_runtime.errors import BridgeError
from firmware_bridge.can import asking
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.feedback import DeadReckoning, PlanarPose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.link import CanLink
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.can.vesc import Vescs, command_timeout_s
from firmware_bridge.guard.core import firmware_timeout_fault

STATUS = Frame(0x901, bytes(8), extended=True)


class Drives:
    """A bus with VESCs: ids, timeouts in ms, brake currents in A."""

    malformed = 0

    def __init__(self, told) -> None:
        self.told = dict(told)
        self.asked: list[Frame] = []
        self.missing, self.posing = 0, None
        self._arrived: deque[Frame] = deque()

    def open(self) -> None:
        pass

    def hear_only(self, identifiers) -> None:
        pass

    def fileno(self) -> int:
        return 0

    def send(self, frame: Frame) -> bool:
        self.asked.append(frame)
        number = frame.frame_id & 0xFF
        if self.missing:
            self.missing -= 1
        elif frame.extended and frame.frame_id >> 8 == 8 and number in self.told:
            self._answer(frame.data[0], number)
        return True

    def receive(self):
        while self._arrived:
            yield self._arrived.popleft()

    def _answer(self, to: int, number: int) -> None:
        timeout_ms, brake_a = self.told[number]
        payload = (
            struct.pack(">BIBIf", 17, 982638166, self.posing or number, timeout_ms, brake_a)
            + bytes(range(256)) * 2
        )
        self._arrived.append(STATUS)
        for offset in range(0, 252, 7):
            piece = bytes([offset]) + payload[offset : offset + 7]
            self._arrived += [Frame(5 << 8 | to, piece, True), STATUS]
        for offset in range(252, len(payload), 6):
            piece = struct.pack(">H", offset) + payload[offset : offset + 6]
            self._arrived.append(Frame(6 << 8 | to, piece, True))
        end = struct.pack(">BBHH", number, 1, len(payload), binascii.crc_hqx(payload, 0))
        self._arrived.append(Frame(7 << 8 | to, end, True))


@pytest.fixture(autouse=True)
def _time_passes_by_waiting(monkeypatch):
    simulate_waits(monkeypatch, asking)


@pytest.mark.parametrize(
    ("told", "timeout_s", "source"),
    [
        ({1: (500, 5.0), 2: (400, 5.0)}, 0.5, "as the VESCs answer"),
        ({1: (1000, 5.0), 2: (400, 0.0)}, 0.0, "VESC 2 lets the wheel roll on after 0.4 s"),
        ({1: (1000, 0.0), 2: (1000, 0.0)}, 0.0, "VESC 1 lets the wheel roll on after 1 s"),
        ({1: (500, 5.0), 2: (0, 5.0)}, 0.0, "as VESC 2 answers"),
        ({1: (60_000, 5.0), 2: (500, 5.0)}, 60.0, "as the VESCs answer"),
    ],
)
def test_the_longest_timeout_counts_and_one_that_brakes_nothing_is_none(told, timeout_s, source):
    found, said = command_timeout_s(Drives(told), Vescs((1, 2)))
    assert found == timeout_s
    assert said.startswith(source)


def test_the_firmwares_defaults_are_not_taken_for_a_stop():
    """1000 ms, 0 A: applications/appconf_default.h."""
    timeout_s, _ = command_timeout_s(Drives({1: (1000, 0.0)}), Vescs((1,)))
    assert firmware_timeout_fault(timeout_s)


def test_the_question_is_one_frame_to_each_with_an_id_of_its_own_to_answer_to():
    drives = Drives({1: (500, 5.0), 2: (500, 5.0)})
    command_timeout_s(drives, Vescs((1, 2)))
    assert drives.asked == [
        Frame(0x801, bytes.fromhex("fd 00 11"), True),
        Frame(0x802, bytes.fromhex("fc 00 11"), True),
    ]


def test_a_lost_question_is_asked_again():
    drives = Drives({1: (500, 5.0)})
    drives.missing = 2
    assert command_timeout_s(drives, Vescs((1,)))[0] == 0.5


def test_one_that_stays_silent_is_named():
    with pytest.raises(BridgeError, match="VESC 7 does not answer"):
        command_timeout_s(Drives({1: (500, 5.0)}), Vescs((1, 7)))


def test_another_ones_answer_is_not_taken():
    drives = Drives({1: (500, 5.0)})
    drives.posing = 2
    with pytest.raises(BridgeError, match="VESC 1 does not answer"):
        command_timeout_s(drives, Vescs((1,)))


@pytest.mark.parametrize("controllers", [(), (-1,), (0xEE,), tuple(range(17))])
def test_ids_that_are_none_or_ours_are_refused(controllers):
    with pytest.raises(msgspec.ValidationError, match="`controllers` must be up to 16 ids in"):
        msgspec.convert({"controllers": controllers}, Vescs)


def test_the_shipped_profile_asks():
    path = profile_path("vesc")
    profile = load_profile(path)
    drives = Drives({1: (300, 2.0), 2: (300, 2.0)})
    link = CanLink(profile, CanCodec(profile, path), drives, DeadReckoning(0, PlanarPose(), profile.base))
    assert link.firmware_timeout_s is None
    link.open()
    assert (link.firmware_timeout_s, link.firmware_timeout_source) == (0.3, "as the VESCs answer")
