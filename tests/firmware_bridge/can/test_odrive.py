"""The watchdog of drives that speak by other people's DBC: odrive-can's, for firmware 0.6.10."""

import socket
import struct

import msgspec
import pytest
from can_peers import guard_spec
from clocks import simulate_waits

import firmware_bridge.can.asking as asking
from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.feedback import DeadReckoning, PlanarPose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.link import CanLink, make_link
from firmware_bridge.can.odrive import Watchdog, watchdog_timeout_s
from firmware_bridge.can.profile import PROFILES, load_profile

TIMEOUT, ENABLE = 0x0099, 0x009A
WATCHDOG = Watchdog(0.5, (0, 1), "0.6.10", TIMEOUT, ENABLE)
HEARTBEAT = Frame(0x01, bytes(8))


class Drives:
    """A bus with two drives, after ODrive's CAN guide: ``struct.pack("<BHB" + format, ...)``."""

    malformed = 0

    def __init__(self) -> None:
        self.parameters = {node: {TIMEOUT: bytes(4), ENABLE: b"\0"} for node in (0, 1)}
        self.version, self.locked, self.silent, self.full = (6, 10), set(), 0, False
        self.asked: list[Frame] = []
        self.written: list[tuple[int, int]] = []
        self._answers: list[Frame] = []
        self._readable, self._end = socket.socketpair()
        self._end.send(b"x")

    def open(self) -> None:
        pass

    def close(self) -> None:
        self._readable.close()
        self._end.close()

    def hear_only(self, identifiers) -> None:
        pass

    def fileno(self) -> int:
        return self._readable.fileno()

    def send(self, frame: Frame) -> bool:
        if self.full:
            return False
        node, command = frame.frame_id >> 5, frame.frame_id & 0x1F
        self.asked.append(frame)
        if self.silent:
            self.silent -= 1
        elif command == 0x00:
            self._answer(node, 0x00, bytes([2, 4, 4, 58, 0, *self.version, 0]))
        elif command == 0x04:
            self._parameter(node, frame.data)
        return True

    def receive(self):
        arrived, self._answers = self._answers, []
        yield from arrived

    def _parameter(self, node: int, data: bytes) -> None:
        opcode, endpoint, _ = struct.unpack_from("<BHB", data)
        if opcode == 0:
            self._answer(node, 0x05, struct.pack("<BHB", 0, endpoint, 0) + self.parameters[node][endpoint])
        else:
            self.written.append((node, endpoint))
            if (node, endpoint) not in self.locked:
                self.parameters[node][endpoint] = data[4:]

    def _answer(self, node: int, command: int, data: bytes) -> None:
        other = Frame((1 - node) << 5 | command, bytes(8))
        stale = Frame(node << 5 | command, struct.pack("<BHB", 0, 0x1234, 0) + b"\1\1\1\1")
        wrong = [stale] if command == 0x05 else []
        extended = Frame(node << 5 | command, data, extended=True)
        self._answers += [HEARTBEAT, other, extended, *wrong, Frame(node << 5 | command, data)]


@pytest.fixture
def drives():
    bus = Drives()
    yield bus
    bus.close()


@pytest.fixture(autouse=True)
def _time_passes_by_waiting(monkeypatch):
    simulate_waits(monkeypatch, asking)


def test_off_as_it_leaves_the_factory_is_told_and_nothing_is_set(drives):
    assert watchdog_timeout_s(drives, WATCHDOG, turn_on=False) == 0.0
    assert drives.written == []


def test_one_drive_that_is_off_counts_for_all(drives):
    drives.parameters[0] = {TIMEOUT: struct.pack("<f", 0.25), ENABLE: b"\1"}
    assert watchdog_timeout_s(drives, WATCHDOG, turn_on=False) == 0.0
    drives.parameters[1] = {TIMEOUT: struct.pack("<f", 0.75), ENABLE: b"\1"}
    assert watchdog_timeout_s(drives, WATCHDOG, turn_on=False) == 0.75


def test_it_is_turned_on_with_its_time_first_and_read_back(drives):
    assert watchdog_timeout_s(drives, WATCHDOG, turn_on=True) == 0.5
    assert drives.parameters == {n: {TIMEOUT: struct.pack("<f", 0.5), ENABLE: b"\1"} for n in (0, 1)}
    assert drives.written == [(0, TIMEOUT), (0, ENABLE), (1, TIMEOUT), (1, ENABLE)]


def test_requests_are_frames_of_the_protocol_document(drives):
    watchdog_timeout_s(drives, msgspec.structs.replace(WATCHDOG, nodes=(1,)), turn_on=True)
    assert drives.asked[:4] == [
        Frame(0x20, b""),
        Frame(0x24, bytes.fromhex("01 9900 00 0000003f")),
        Frame(0x24, bytes.fromhex("00 9900 00")),
        Frame(0x24, bytes.fromhex("01 9a00 00 01")),
    ]


def test_requests_and_answers_are_those_of_odrive_cans_dbc(drives):
    database = pytest.importorskip("odrive_can").get_dbc()
    watchdog_timeout_s(drives, WATCHDOG, turn_on=True)
    write = database.get_message_by_name("Axis0_RxSdo")
    assert drives.asked[1].frame_id == write.frame_id
    fields = write.decode(drives.asked[1].data, decode_choices=False)
    assert (fields["Opcode"], fields["Endpoint_ID"]) == (1, TIMEOUT)
    assert fields["Value"] == int.from_bytes(struct.pack("<f", 0.5), "little")
    assert database.get_message_by_name("Axis0_TxSdo").frame_id == 0x05
    assert database.get_message_by_name("Axis0_Get_Version").frame_id == 0x00


def test_another_firmware_is_not_written_to(drives):
    drives.version = (6, 11)
    with pytest.raises(BridgeError, match=r"node 0 has firmware 0.6.11: .* it says 0.6.10"):
        watchdog_timeout_s(drives, WATCHDOG, turn_on=True)
    assert drives.written == []


@pytest.mark.parametrize(("endpoint", "name"), [(TIMEOUT, "watchdog_timeout"), (ENABLE, "enable_watchdog")])
def test_a_parameter_that_is_not_kept_is_refused(drives, endpoint, name):
    drives.locked = {(1, endpoint)}
    with pytest.raises(BridgeError, match=f"node 1 keeps axis0.config.{name} at 00.* is {endpoint} its id"):
        watchdog_timeout_s(drives, WATCHDOG, turn_on=True)


def test_a_lost_answer_is_asked_for_again(drives):
    drives.silent = 2
    assert watchdog_timeout_s(drives, WATCHDOG, turn_on=False) == 0.0
    assert [frame.frame_id for frame in drives.asked[:3]] == [0x00] * 3


def test_a_silent_drive_is_named(drives):
    drives.silent = 10**6
    with pytest.raises(BridgeError, match="ODrive node 0 does not answer: check power"):
        watchdog_timeout_s(drives, WATCHDOG, turn_on=True)
    assert len(drives.asked) == 3


def test_a_full_queue_is_no_silent_failure(drives):
    drives.full = True
    with pytest.raises(BridgeError, match="does not answer"):
        watchdog_timeout_s(drives, WATCHDOG, turn_on=True)


def test_a_write_that_the_queue_refuses_is_said(drives):
    send, writes = drives.send, []

    def refuse_writes(frame):
        if frame.data[:1] == b"\1":
            writes.append(frame)
            return False
        return send(frame)

    drives.send = refuse_writes
    with pytest.raises(BridgeError, match="node 0: the transmit queue is full"):
        watchdog_timeout_s(drives, WATCHDOG, turn_on=True)
    assert len(writes) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"timeout_s": 0.0}, "timeout_s"),
        ({"timeout_s": float("nan")}, "timeout_s"),
        ({"timeout_s": 1.5}, "timeout_s"),
        ({"nodes": ()}, "nodes"),
        ({"nodes": (64,)}, "nodes"),
        ({"nodes": (-1,)}, "nodes"),
        ({"timeout_endpoint": 0}, "endpoint ids"),
        ({"enable_endpoint": 2**16}, "endpoint ids"),
    ],
)
def test_what_cannot_be_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        Watchdog(**{**msgspec.structs.asdict(WATCHDOG), **change})


@pytest.fixture
def profile_file(tmp_path):
    (tmp_path / "odrive_cansimple.dbc").write_text((PROFILES / "odrive_cansimple.dbc").read_text())
    text = (PROFILES / "odrive_cansimple.toml").read_text()
    table = text.index("# [watchdog]")
    lines = text[table:].replace("# ", "").replace("...", "153")
    path = tmp_path / "mine.toml"
    path.write_text(text[:table] + lines)
    return path


@pytest.mark.parametrize(("arm", "timeout_s"), [(False, 0.0), (True, 0.5)])
def test_the_shipped_profiles_table_works_once_its_ids_are_in(drives, profile_file, arm, timeout_s):
    profile = load_profile(profile_file)
    profile = msgspec.structs.replace(profile, watchdog=WATCHDOG)
    robot = DeadReckoning(0, PlanarPose(), profile.base)
    link = CanLink(profile, CanCodec(profile, profile_file), drives, robot, arm)
    assert link.firmware_timeout_s is None
    link.open()
    assert link.firmware_timeout_s == timeout_s


def test_only_an_armed_guard_turns_it_on(profile_file):
    for arm in (True, False):
        assert make_link(guard_spec("can0", str(profile_file), arm=arm))._arm is arm


def test_a_timeout_in_the_profile_beside_it_is_refused(profile_file):
    profile_file.write_text(
        profile_file.read_text().replace("recoveries", "firmware_timeout_s = 0.5\nrecoveries")
    )
    with pytest.raises(ConfigError, match="give one of `firmware_timeout_s`, `watchdog` and `vesc`"):
        load_profile(profile_file)
