"""Packets between loop and logger: every record comes back bit for bit, in order."""

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.messages import (
    LONGEST_ACTION,
    Command,
    GuidedAction,
    Reading,
    RobotState,
    Teammate,
    TeamState,
    TrackedObject,
)
from edge_runtime.observation.familiarity import Unfamiliar
from edge_runtime.recording.schema import End, Inputs, LoggedObjectiveSet, Observation, StageTimes, Tick
from edge_runtime.recording.wire import decode_packet, encode_packet, pack_tick, tick_packet

floats = st.floats(allow_nan=True, allow_infinity=True)
numbers = st.integers(0, 2**40)
places = st.lists(floats, min_size=2, max_size=3).map(tuple)
vectors = st.lists(floats, min_size=1, max_size=LONGEST_ACTION).map(tuple)
many = st.lists(floats, max_size=4).map(tuple)
states = st.builds(RobotState, st.integers(0, 9), floats, places, places, floats, floats)
mates = st.lists(st.builds(Teammate, states, vectors, floats), max_size=3).map(tuple)
tracked = st.builds(
    TrackedObject, st.text(), floats, places, places, floats, floats, floats, st.none() | places
)
readings = st.builds(Reading, st.text(), many)
teams = st.builds(
    TeamState,
    states,
    mates,
    st.text(),
    st.none() | many,
    mates,
    st.lists(tracked, max_size=2).map(tuple),
    st.lists(readings, max_size=2).map(tuple),
)
actions = st.builds(GuidedAction, vectors, st.integers(0, 9), many, correction=vectors, cut=st.booleans())
commands = st.builds(Command, st.integers(0, 9), numbers, floats, vectors, places, floats, st.text())
ticks = st.builds(
    Tick,
    st.builds(Inputs, numbers, floats, numbers, numbers, vectors, vectors, floats),
    teams,
    st.builds(Observation, st.lists(st.floats(width=32), max_size=9).map(tuple), st.text(), floats),
    actions,
    commands,
    st.builds(StageTimes, *[floats] * 7),
)
others = st.one_of(
    st.builds(End, st.text(), st.booleans(), numbers, numbers, numbers),
    st.builds(LoggedObjectiveSet, numbers, st.text(), floats, floats, floats, st.just(())),
)


def packet_of(record, buffer):
    if not isinstance(record, Tick):
        return encode_packet(record)
    inputs, laps = record.inputs, [getattr(record.timing, name) for name in StageTimes.__struct_fields__]
    values = record.observation.values
    seen = memoryview(struct.pack(f"={len(values)}f", *values))
    pack_tick(
        (
            inputs.number,
            inputs.deadline_s,
            inputs.misses,
            inputs.objectives_version,
            inputs.start,
            inputs.previous_action,
            inputs.elapsed_s,
            record.state,
            seen,
            record.action,
            record.command,
            laps,
            Unfamiliar(record.observation.unfamiliar, record.observation.unfamiliar_s),
        ),
        buffer,
    )
    return bytes(buffer)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.one_of(ticks, others), max_size=5))
def test_records_come_back_bit_for_bit(records):
    buffer = tick_packet()  # what is left of the last tick must not show
    packets = [packet_of(record, buffer) for record in records]
    assert repr([decode_packet(packet) for packet in packets]) == repr(records)
