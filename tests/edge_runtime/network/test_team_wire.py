"""Frames survive the way; nothing else passes for one."""

import hashlib
import hmac
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.common.bounds import GREATEST, GREATEST_SPEED_M_S
from edge_runtime.messages import LONGEST_ACTION, RobotState
from edge_runtime.network.seal import MAGIC_BYTES, TAG_BYTES, FrameError, Magic, Refusal, seal
from edge_runtime.network.team_wire import FRAME_BYTES, LAST_TICK, Frame, GuideVersions, decode, encode

KEY = bytes(range(32))
FRAME = Frame(
    2,
    3,
    4,
    5,
    6,
    RobotState(1, 7.0, (8.0, 9.0), (10.0, 11.0), 12.0, 20.0),
    (13.0, 14.0),
    True,
    16,
    GuideVersions(15, 17, 18, 19),
)

numbers = st.floats(-GREATEST, GREATEST)
speeds = st.floats(-GREATEST_SPEED_M_S, GREATEST_SPEED_M_S)
shorts = st.integers(0, 2**16 - 1)
longs = st.integers(0, 2**64 - 1)
states = st.sampled_from([2, 3]).flatmap(
    lambda dims: st.builds(
        RobotState,
        shorts,
        numbers,
        st.tuples(*[numbers] * dims),
        st.tuples(*[speeds] * dims),
        numbers,
        numbers,
    )
)
actions = st.lists(numbers, min_size=1, max_size=LONGEST_ACTION).map(tuple)
ticks = st.integers(0, LAST_TICK)
versions_of_guides = st.builds(GuideVersions, st.integers(0, 2**32 - 1), longs, longs, ticks)
frames = st.builds(
    Frame, shorts, longs, longs, longs, longs, states, actions, st.booleans(), ticks, versions_of_guides
)


def refusal(packet, key=KEY):
    with pytest.raises(FrameError) as caught:
        decode(packet, key)
    return caught.value.cause


@given(frame=frames, key=st.binary(min_size=32, max_size=32))
def test_frames_survive_the_way(frame, key):
    packet = encode(frame, key)
    assert len(packet) == FRAME_BYTES
    assert decode(packet, key) == frame


def test_the_layout_is_the_documented_one():
    body = b"CFP\x03" + struct.pack("<HHIBBBx", 1, 2, 15, 1, 2, 2)
    body += struct.pack("<8Q", 3, 4, 5, 6, 16, 17, 18, 19)
    body += struct.pack("<9d", 7, 8, 9, 0, 10, 11, 0, 12, 20) + struct.pack("<8d", 13, 14, *[0] * 6)
    assert encode(FRAME, KEY) == body + hmac.new(KEY, body, hashlib.sha256).digest()


def test_every_altered_bit_is_noticed():
    packet = encode(FRAME, KEY)
    for bit in range(8 * FRAME_BYTES):
        altered = bytearray(packet)
        altered[bit // 8] ^= 1 << bit % 8
        assert refusal(bytes(altered)) is (Refusal.MALFORMED if bit < 32 else Refusal.FOREIGN)


@given(junk=st.binary(max_size=2 * FRAME_BYTES))
def test_junk_is_refused(junk):
    assert refusal(junk) is Refusal.MALFORMED


@given(body=st.binary(min_size=FRAME_BYTES - 4, max_size=FRAME_BYTES - 4))
def test_junk_with_the_right_length_and_magic_is_refused(body):
    assert refusal(b"CFP\x03" + body) is Refusal.FOREIGN


@given(frame=frames, key=st.binary(min_size=32, max_size=32).filter(lambda key: key != KEY))
def test_junk_made_with_another_key_is_refused(frame, key):
    assert refusal(encode(frame, key)) is Refusal.FOREIGN


@given(frame=frames, cut=st.integers(1, FRAME_BYTES), more=st.binary(min_size=1))
def test_junk_lengths_are_refused(frame, cut, more):
    packet = encode(frame, KEY)
    assert refusal(packet[:-cut]) is refusal(packet + more) is Refusal.MALFORMED


def test_ticks_that_no_team_reaches_are_refused():
    versions = replace(FRAME.versions, next_tick=LAST_TICK + 1)
    for frame in (replace(FRAME, tick=LAST_TICK + 1), replace(FRAME, versions=versions)):
        assert refusal(encode(frame, KEY)) is Refusal.MALFORMED


def test_numbers_that_no_robot_has_are_refused_as_in_streams():
    state = FRAME.state
    for frame in (
        replace(FRAME, intended_action=(0.0, -1e300)),
        replace(FRAME, state=replace(state, position_m=(1.1e6, 0.0))),
        replace(FRAME, state=replace(state, position_m=(0.0, 1e300))),
        replace(FRAME, state=replace(state, velocity_m_s=(0.0, -1.1e3))),
        replace(FRAME, state=replace(state, heading_rad=1e300)),
        replace(FRAME, state=replace(state, yaw_rate_rad_s=-1e300)),
        replace(FRAME, state=replace(state, position_m=(0.0, 0.0, 1e7), velocity_m_s=(0.0, 0.0, 0.0))),
    ):
        assert refusal(encode(frame, KEY)) is Refusal.MALFORMED


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    state = FRAME.state
    for frame in (
        replace(FRAME, intended_action=(0.0, bad)),
        replace(FRAME, state=replace(state, stamp_s=bad)),
        replace(FRAME, state=replace(state, position_m=(bad, 0.0))),
        replace(FRAME, state=replace(state, velocity_m_s=(0.0, bad))),
        replace(FRAME, state=replace(state, heading_rad=bad)),
        replace(FRAME, state=replace(state, yaw_rate_rad_s=bad)),
        replace(FRAME, intended_action=(*[0.0] * 7, bad)),
    ):
        assert refusal(encode(frame, KEY)) is Refusal.NOT_FINITE


@pytest.mark.parametrize(("place", "number"), [(13, 0), (13, 1), (13, 4), (14, 0), (14, 9), (14, 255)])
def test_vectors_of_no_known_length_are_refused(place, number):
    packet = bytearray(encode(FRAME, KEY)[:-TAG_BYTES])
    packet[place] = number
    sealed = seal(Magic.TEAM, bytes(packet[MAGIC_BYTES:]), KEY)
    assert refusal(sealed) is Refusal.MALFORMED


@pytest.mark.parametrize("magic", [b"CFP\x01", b"CFP\x02", b"CFP\x04"])
def test_frames_of_another_version_are_refused(magic):
    assert refusal(magic + encode(FRAME, KEY)[MAGIC_BYTES:]) is Refusal.MALFORMED
