"""A log's messages: exact, and described by schemas that others read."""

import json
import math

import jsonschema
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import record
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.recording.json_codec import decoder, encode, json_schema
from edge_runtime.recording.schema import CHANNELS

floats = st.floats(allow_nan=True, allow_infinity=True)
pairs = st.tuples(floats, floats)
states = st.builds(RobotState, st.integers(0, 9), floats, pairs, pairs, floats)
teams = st.builds(
    TeamState,
    states,
    st.lists(st.builds(Teammate, states, pairs, floats), max_size=3).map(tuple),
    st.one_of(st.text(), st.just(',"ranges_m":null'), st.just('x","ranges_m":null,"')),
    st.none() | st.lists(floats, max_size=3).map(tuple),
)


@given(teams)
def test_a_record_comes_back_bit_for_bit(team):
    """NaN has one form here; every other float, -0.0 and the smallest too, keeps its bits."""
    message = encode(team)
    assert repr(decoder(TeamState).decode(message)) == repr(team)
    json.loads(message, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


@given(teams)
def test_what_is_none_is_left_out(team):
    assert ("ranges_m" in json.loads(encode(team))) == (team.ranges_m is not None)


def test_what_is_not_finite_is_spelled_as_protobuf_spells_it():
    state = RobotState(0, math.nan, (math.inf, -math.inf), (0.0, 0.0))
    written = json.loads(encode(state))
    assert (written["stamp_s"], written["position_m"]) == ("NaN", ["Infinity", "-Infinity"])


def foxglove_type(schema):
    """What Foxglove's reader of JSON Schema accepts: types by name, objects and arrays of such."""
    kind = schema["type"]
    assert kind in {"object", "array", "string", "number", "integer", "boolean"}
    assert not {"$ref", "anyOf", "oneOf", "prefixItems"} & schema.keys()
    if kind == "object":
        for field in schema["properties"].values():
            foxglove_type(field)
    if kind == "array":
        assert schema["items"]["type"] != "array"
        foxglove_type(schema["items"])


@pytest.mark.parametrize("topic", CHANNELS)
def test_a_schema_is_one_that_foxglove_reads(topic):
    schema = json.loads(json_schema(CHANNELS[topic][1]))
    jsonschema.Draft202012Validator.check_schema(schema)
    foxglove_type(schema)


def test_poses_and_events_have_the_fields_of_foxgloves_own_schemas():
    """As published at github.com/foxglove/schemas, schemas/jsonschema."""
    poses, log = (json.loads(json_schema(CHANNELS[name][1]))["properties"] for name in ("poses", "events"))
    assert set(poses) == {"timestamp", "frame_id", "poses"}
    pose = poses["poses"]["items"]["properties"]
    assert set(pose["position"]["properties"]) == set("xyz")
    assert set(pose["orientation"]["properties"]) == set("xyzw")
    assert set(log) == {"timestamp", "level", "message", "name", "file", "line"}
    assert set(log["timestamp"]["properties"]) == {"sec", "nsec"}
    assert (CHANNELS["poses"][0], CHANNELS["events"][0]) == ("foxglove.PosesInFrame", "foxglove.Log")


def test_every_message_of_a_run_is_valid_under_its_channels_schema(tmp_path):
    (path,) = record(tmp_path)
    schemas, channels, seen = {}, {}, set()
    with path.open("rb") as file:
        for item in StreamReader(file, validate_crcs=True).records:
            if isinstance(item, Schema):
                assert item.encoding == "jsonschema"
                schemas[item.id] = jsonschema.Draft202012Validator(json.loads(item.data))
            elif isinstance(item, Channel):
                assert item.message_encoding == "json"
                channels[item.id] = item
            elif isinstance(item, Message):
                channel = channels[item.channel_id]
                schemas[channel.schema_id].validate(json.loads(item.data))
                seen.add(channel.topic)
    assert seen == {f"/{topic}" for topic in CHANNELS}


def test_a_record_that_json_schema_cannot_tell_foxglove_is_refused():
    class Odd(msgspec.Struct):
        table: dict[str, int]

    with pytest.raises(TypeError, match="cannot hold"):
        json_schema(Odd)
