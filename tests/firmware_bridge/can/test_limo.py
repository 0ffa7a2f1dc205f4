"""The Limo's serial framing, against the vendor's published layout and a pseudo terminal."""

import contextlib
import errno
import os
import pty
import select
import tty

import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import HANG_S, until

from edge_runtime.errors import BridgeError
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.limo import FrameReader, LimoPort, frame_bytes

frames = st.builds(Frame, st.integers(0, 0x7FF), st.binary(min_size=8, max_size=8), st.just(False))


def test_the_published_layout():
    # 0x55, 0x0E, identifier, 8 data bytes, counter, sum of the data: take command, mecanum.
    sent = frame_bytes(Frame(0x421, bytes([1, 0, 1, 0, 0, 0, 0, 0])), 9)
    assert sent == bytes.fromhex("55 0E 04 21 01 00 01 00 00 00 00 00 09 02")
    assert frame_bytes(Frame(0x111, b"\xff\x38"), 0)[-1] == 0x37


@given(st.lists(frames, max_size=5), st.integers(1, 13))
def test_frames_survive_any_cutting(sent, size):
    stream = b"".join(frame_bytes(frame, 0) for frame in sent)
    reader = FrameReader()
    pieces = [stream[start : start + size] for start in range(0, len(stream), size)]
    assert [frame for piece in pieces for frame in reader.feed(piece)] == sent
    assert reader.malformed == 0


@given(st.binary(max_size=200), frames)
def test_junk_is_skipped(junk, frame):
    reader = FrameReader()
    list(reader.feed(junk))
    found = [*reader.feed(bytes(14)), *reader.feed(frame_bytes(frame, 0))]
    assert found[-1:] == [frame]


@given(st.binary(max_size=500))
def test_the_reader_keeps_less_than_a_frame(junk):
    reader = FrameReader()
    list(reader.feed(junk))
    assert len(reader._buffer) < 14


def test_a_wrong_sum_is_refused_and_the_next_frame_found():
    wrong = bytearray(frame_bytes(Frame(0x221, bytes(range(8))), 0))
    wrong[5] ^= 1
    right = Frame(0x221, bytes(8))
    reader = FrameReader()
    assert list(reader.feed(bytes(wrong) + frame_bytes(right, 1))) == [right]
    assert reader.malformed == 1


@pytest.fixture
def line():
    robot, computer = pty.openpty()
    tty.setraw(robot)
    os.set_blocking(robot, False)
    port = LimoPort(os.ttyname(computer))
    port.open()
    yield robot, port
    port.close()
    for descriptor in (robot, computer):
        with contextlib.suppress(OSError):
            os.close(descriptor)


def read(robot, size):
    received = b""
    while len(received) < size:
        select.select((robot,), (), (), HANG_S)
        received += os.read(robot, size)
    return received


def test_frames_go_both_ways_and_are_counted(line):
    robot, port = line
    assert port.fileno() > 0
    assert list(port.receive()) == []  # Nothing there is not a hang-up.
    assert port.send(Frame(0x111, bytes(8)))
    assert port.send(Frame(0x111, bytes(8)))
    assert [frame[12] for frame in (read(robot, 14), read(robot, 14))] == [0, 1]
    os.write(robot, frame_bytes(Frame(0x221, bytes(range(8))), 0))
    assert until(lambda: list(port.receive())) == [Frame(0x221, bytes(range(8)))]


def test_a_full_port_drops_and_never_blocks(line):
    _, port = line
    taken = [port.send(Frame(0x111, bytes(8))) for _ in range(20000)]
    assert taken[0]
    assert not taken[-1]


def test_a_pulled_cable_is_an_error(line):
    robot, port = line
    os.close(robot)
    with pytest.raises(BridgeError, match="lost"):
        list(port.receive())
    with pytest.raises(BridgeError, match="lost"):
        port.send(Frame(0x111, bytes(8)))


def test_a_port_that_hung_up_is_an_error(line, monkeypatch):
    os.write(line[0], b"x")
    select.select((line[1].fileno(),), (), (), 10)
    monkeypatch.setattr(os, "read", lambda *_: b"")
    with pytest.raises(BridgeError, match="hung up"):
        list(line[1].receive())


def test_a_read_that_fails_is_an_error(line, monkeypatch):
    def fail(*_):
        raise OSError(errno.EIO, "input/output error")

    os.write(line[0], b"x")
    select.select((line[1].fileno(),), (), (), 10)
    monkeypatch.setattr(os, "read", fail)
    with pytest.raises(BridgeError, match="input/output error"):
        list(line[1].receive())


def test_ports_that_are_not_there_or_not_open():
    port = LimoPort("/dev/not-there")
    with pytest.raises(BridgeError, match="/dev/not-there"):
        port.open()
    with pytest.raises(BridgeError, match="not open"):
        port.fileno()
    port.close()
