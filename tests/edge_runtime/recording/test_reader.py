"""Reading logs that are whole, cut, damaged, foreign or of another format."""

import itertools
import os
import tracemalloc

import foreign_logs
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs import in_space, record, ticks, with_tick, write
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from msgspec.structs import replace

from edge_runtime.errors import ConfigError
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import READ_FORMATS, End, LoggedObjectiveSet, Start, Tick

CHUNK = 5


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log whose chunks hold `CHUNK` ticks each."""
    folder = tmp_path_factory.mktemp("log")
    (path,) = record(folder)
    return write(folder / "chunks.mcap", read_log(path), CHUNK)


@pytest.fixture(scope="module")
def whole(log):
    return ticks(log)


@pytest.fixture(scope="module")
def chunk_ends(log):
    """Where each chunk with whole ticks ends in the file."""
    with log.open("rb") as file:
        return [index.chunk_start_offset + index.chunk_length for index in chunks_of(file)]


def chunks_of(file):
    return make_reader(file).get_summary().chunk_indexes


def test_a_log_begins_with_its_start_and_ends_with_its_end(log):
    first, second, *between, last = read_log(log)
    assert isinstance(first, Start)
    assert isinstance(second, LoggedObjectiveSet) or second.name == "start"
    assert isinstance(last, End)
    numbers = [item.inputs.number for item in between if isinstance(item, Tick)]
    assert numbers == list(range(last.ticks))
    assert (last.lost, last.stop_reason, last.failed) == (0, "duration", False)


def test_a_tick_holds_what_the_loop_had(log):
    for before, tick in itertools.pairwise(ticks(log)):
        assert tick.inputs.previous_action == before.command.action
        assert tick.command.sequence == before.command.sequence + 1
        assert len(tick.action.costs) == len(tick.action.conflicts) == 2
        assert [mate.state.robot_id for mate in tick.state.teammates] == [1, 2, 3]
        assert tick.timing.tick > tick.timing.act > 0.0


@settings(max_examples=60)
@given(st.data())
def test_a_log_cut_anywhere_reads_up_to_the_cut(log, whole, chunk_ends, tmp_path_factory, data):
    content = log.read_bytes()
    size = data.draw(st.integers(8, len(content) - 1))
    path = tmp_path_factory.mktemp("cut") / "cut.mcap"
    path.write_bytes(content[:size])
    *records, last = read_log(path)
    assert isinstance(last, Damage)
    found = [item for item in records if isinstance(item, Tick)]
    assert found == whole[: len(found)]
    assert len(found) == min(CHUNK * sum(end <= size for end in chunk_ends), len(whole))


@settings(max_examples=60)
@given(st.data())
def test_a_log_with_a_wrong_byte_never_reads_wrong_ticks(log, whole, tmp_path_factory, data):
    content = bytearray(log.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("wrong") / "wrong.mcap"
    path.write_bytes(content)
    try:
        records = list(read_log(path))
    except ConfigError:
        return
    found = [item for item in records if isinstance(item, Tick)]
    right = {tick.inputs.number: tick for tick in whole}
    assert all(right[tick.inputs.number] == tick for tick in found)
    assert found == whole or isinstance(records[-1], Damage)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"\x89PNG\r\n\x1a\n and so on", b"# a text"])
def test_a_foreign_file_is_refused(tmp_path, content):
    path = tmp_path / "foreign.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"foreign\.mcap: is not an MCAP file"):
        list(read_log(path))


def test_another_mcap_file_is_refused(tmp_path):
    path = tmp_path / "camera.mcap"
    writer = Writer(str(path))
    writer.start()
    schema = writer.register_schema("sensor", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/camera", "json", schema)
    writer.add_message(channel, 0, b"{}", 0)
    writer.finish()
    with pytest.raises(ConfigError, match="no log of edge-run"):
        list(read_log(path))


def test_another_format_is_refused_by_both_names(log, tmp_path):
    start, *rest = read_log(log)
    path = write(tmp_path / "newer.mcap", [replace(start, format="cfpg-log/7"), *rest])
    with pytest.raises(ConfigError, match=f"'cfpg-log/7', this version reads {', '.join(READ_FORMATS)}"):
        list(read_log(path))


def lengthened(vector):
    return (*vector, 0.0)


@pytest.mark.parametrize(
    ("said", "changes"),
    [
        (
            "a position or velocity that has not 2 components",
            {"command": lambda one: replace(one, velocity_m_s=lengthened(one.velocity_m_s))},
        ),
        (
            "a position or velocity that has not 2 components",
            {"state": lambda one: replace(one, own=replace(one.own, position_m=(0.0, 0.0, 0.0)))},
        ),
        ("actions of different lengths", {"command": lambda one: replace(one, action=(0.0,) * 3)}),
        ("actions of different lengths", {"inputs": lambda one: replace(one, start=(0.0,))}),
    ],
)
def test_vectors_of_different_lengths_are_damage(log, tmp_path, said, changes):
    *_, before, number = (tick.inputs.number for tick in ticks(log)[:3])
    path = with_tick(log, tmp_path / "odd.mcap", number, **changes)
    assert damage(path) == f"tick {number} has {said} after tick {before}"


def test_a_log_of_robots_in_space_reads(log, tmp_path):
    path = in_space(log, tmp_path / "space.mcap")
    assert len(ticks(path)) == len(ticks(log)) > 0
    assert ticks(path)[0].command.action == (*ticks(log)[0].command.action, 0.0)


def test_a_fleet_partly_in_space_is_none(log, tmp_path):
    first, *_ = read_log(in_space(log, tmp_path / "space.mcap"))
    robot, *others = first.fleet.robots
    with pytest.raises(ValueError, match="all be in the plane, or all in space"):
        replace(first.fleet, robots=(replace(robot, goal_m=(0.0, 0.0)), *others))


def test_a_missing_file_is_one_line(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        list(read_log(tmp_path / "none.mcap"))


def damage(path):
    """Where reading ended; whatever came before is read."""
    *_, last = read_log(path)
    assert isinstance(last, Damage)
    assert "\n" not in last.message
    return last.message


@pytest.fixture(scope="module")
def messages(log):
    return foreign_logs.messages_of(log)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_what_another_writer_makes_of_a_log_is_read_alike(log, messages, tmp_path, compression):
    again = foreign_logs.write(tmp_path / "again.mcap", messages, compression)
    assert list(read_log(again)) == list(read_log(log))


def test_chunks_that_edge_run_does_not_pack_so(messages, tmp_path):
    other = foreign_logs.write(tmp_path / "lz4.mcap", messages, CompressionType.LZ4)
    assert "compressed by lz4" in damage(other)


@pytest.mark.parametrize(("packed", "claimed"), [
    (1 << 31, 1 << 31), (1 << 31, 1000), (1 << 26, 1 << 26), (1 << 20, 1 << 20), (1 << 20, 2**63),
])  # fmt: skip
def test_a_packed_bomb_is_not_unpacked(messages, tmp_path, packed, claimed):
    (_, start), *_ = messages
    bomb = foreign_logs.with_chunk(tmp_path / "bomb.mcap", start, foreign_logs.packed_zeros(packed), claimed)
    assert bomb.stat().st_size < 200_000
    tracemalloc.start()
    try:
        assert "that unpacks to" in damage(bomb)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def changed(path, messages, topic, change):
    """Write a log of which the first message on a topic is another one."""
    place = [name for name, _ in messages].index(topic)
    _, content = messages[place]
    others = [*messages[:place], (topic, change(content)), *messages[place + 1 :]]
    return foreign_logs.write(path, others, CompressionType.NONE)


DEEP = b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}"


@pytest.mark.parametrize("topic", ["/inputs", "/state", "/events", "/objectives", "/end"])
@pytest.mark.parametrize(
    "content", [DEEP, b"", b"no JSON", b"\xff", b"[]", b"null", b'{"a": ' + b"9" * 5000 + b"}"]
)
def test_messages_that_are_not_what_their_channel_holds(messages, tmp_path, topic, content):
    path = changed(tmp_path / "other.mcap", messages, topic, lambda _: content)
    assert f"a message on {topic} does not read (" in damage(path)


@pytest.mark.parametrize("content", [DEEP, b"no JSON", b"\xff", b"[]"])
def test_starts_that_are_none(messages, tmp_path, content):
    path = changed(tmp_path / "other.mcap", messages, "/start", lambda _: content)
    with pytest.raises(ConfigError, match="does not begin with /start"):
        list(read_log(path))


@pytest.mark.parametrize(("topic", "old", "new"), [
    ("/start", b'"robot_id":0', b'"robot_id":7'),
    ("/start", b'"robot_id":0', b'"robot_id":' + b"9" * 30),
    ("/start", b'"rate_hz":100.0', b'"rate_hz":0.0'),
    ("/start", b'"rate_hz":100.0', b'"rate_hz":"NaN"'),
    ("/start", b'"radius_m":', b'"radius_m":-1.0,"x":'),
    ("/start", b'"goal_m":[', b'"goal_m":["Infinity",0.0],"x":['),
    ("/start", b'"started_unix_s":', b'"started_unix_s":1e300,"x":'),
    ("/state", b'"robot_id":1', b'"robot_id":' + b"9" * 30),
    ("/command", b'"sequence":', b'"sequence":1' + b"0" * 30),
    ("/objectives", b'"parameters":"{', b'"parameters":"[{'),
    ("/objectives", b'"parameters":"', b'"parameters":"' + b"[" * 100_000),
])  # fmt: skip
def test_numbers_that_no_robot_writes(messages, tmp_path, topic, old, new):
    def change(content):
        assert old in content
        return content.replace(old, new, 1)

    path = changed(tmp_path / "other.mcap", messages, topic, change)
    assert f"a message on {topic} does not read (" in damage(path)


def test_ticks_that_are_out_of_order(messages, tmp_path):
    swapped = messages[:]
    first, second = [place for place, (topic, _) in enumerate(messages) if topic == "/inputs"][:2]
    swapped[first], swapped[second] = swapped[second], swapped[first]
    path = foreign_logs.write(tmp_path / "other.mcap", swapped)
    assert damage(path) == "tick 0 is out of order after tick 1"


def test_a_pipe_is_no_log(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match=r"pipe: cannot be read \(not a regular file\)"):
        list(read_log(tmp_path / "pipe"))
