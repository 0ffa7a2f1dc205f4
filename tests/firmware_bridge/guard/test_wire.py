import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.messages import LONGEST_ACTION, RobotState
from firmware_bridge.guard.link import Setpoint
from firmware_bridge.guard.wire import (
    MAGIC,
    PACKET_BYTES,
    Complaint,
    Counts,
    Event,
    Phase,
    Report,
    StopRequest,
    WireError,
    decode_answer,
    decode_request,
    encode_command,
    encode_event,
    encode_report,
    encode_stop,
)

numbers = st.floats(allow_nan=False)
planes, spaces = (st.tuples(*[numbers] * dims) for dims in (2, 3))
actions = st.lists(numbers, min_size=1, max_size=LONGEST_ACTION).map(tuple)
counts = st.builds(Counts, *[st.integers(0, 2**64 - 1)] * 5)
ids = st.integers(0, 2**64 - 1)
states = st.one_of(
    st.builds(RobotState, ids, numbers, places, places, numbers, numbers) for places in (planes, spaces)
)
setpoints = st.builds(Setpoint, ids, numbers, actions, planes | spaces, numbers)


@given(setpoints)
def test_commands_come_back(setpoint):
    assert decode_request(encode_command(setpoint)) == setpoint


@given(st.builds(Report, st.sampled_from(Phase), counts, st.none() | states, st.none() | numbers))
def test_reports_come_back(report):
    packet = encode_report(report, 1.0)
    assert len(packet) <= PACKET_BYTES
    assert decode_answer(packet) == report


@given(st.sampled_from(Phase), st.text(st.characters(min_codepoint=1, max_codepoint=127), max_size=240))
def test_events_come_back(phase, text):
    assert decode_answer(encode_event(Event(phase, text), 1.0)) == Event(phase, text)


@given(st.text(st.characters(min_codepoint=1, max_codepoint=127), max_size=240))
def test_complaints_come_back(text):
    assert decode_answer(encode_event(Complaint(text), 1.0)) == Complaint(text)


def test_stops_come_back():
    assert decode_request(encode_stop("enough", 1.0)) == StopRequest("enough")


def test_long_texts_are_cut_even_inside_a_letter():
    request = decode_request(encode_stop("a" * 95 + "ü", 1.0))
    assert request.reason.startswith("a" * 95)


def test_nan_survives_so_that_the_guard_can_refuse_it():
    packet = encode_command(Setpoint(0, 0.0, (math.nan, 0.0), (0.0, 0.0)))
    assert math.isnan(decode_request(packet).action[0])


@given(setpoints, st.integers(0, 255), st.integers(0, 255))
def test_an_action_of_another_length_than_the_frame_is_refused(setpoint, action, dims):
    packet = bytearray(encode_command(setpoint))
    packet[20:22] = action, dims
    lengths = len(setpoint.action), len(setpoint.velocity_m_s)
    fits = 1 <= action <= 8 and dims in (2, 3) and action + dims == sum(lengths)
    if fits:
        decoded = decode_request(bytes(packet))
        assert (len(decoded.action), len(decoded.velocity_m_s)) == (action, dims)
        return
    said = f"an action of {action} and a velocity of {dims} components in {len(packet)} bytes"
    with pytest.raises(WireError, match=said):
        decode_request(bytes(packet))


@given(st.sampled_from([1, *range(4, 256)]))
def test_a_state_of_another_length_is_refused(dims):
    packet = bytearray(encode_report(Report(Phase.DRIVING, Counts(), None), 1.0))
    packet[21] = dims
    with pytest.raises(WireError, match=f"a state of {dims} components"):
        decode_answer(bytes(packet))


@given(st.binary(max_size=300))
def test_junk_is_refused_by_both_sides(packet):
    for decode in (decode_request, decode_answer):
        with pytest.raises(WireError):
            decode(packet)


@given(st.binary(max_size=300))
def test_junk_behind_a_right_header_never_crashes(body):
    for kind in range(6):
        for decode in (decode_request, decode_answer):
            try:
                decode(struct.pack("<HB", MAGIC, kind) + body)
            except WireError:
                continue


def test_each_side_refuses_the_other_sides_frames():
    with pytest.raises(WireError, match="kind 4"):
        decode_request(encode_event(Event(Phase.DRIVING, ""), 0.0))
    with pytest.raises(WireError, match="kind 2"):
        decode_answer(encode_stop("", 0.0))


def test_unknown_phases_are_refused():
    packet = bytearray(encode_event(Event(Phase.DRIVING, ""), 0.0))
    packet[20] = 99
    with pytest.raises(WireError, match="phase 99"):
        decode_answer(bytes(packet))
