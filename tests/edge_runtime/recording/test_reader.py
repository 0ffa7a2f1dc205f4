"""Reading logs that are whole, cut, damaged, foreign or of another format."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs import record, ticks, write
from mcap.reader import make_reader
from mcap.writer import Writer
from msgspec.structs import replace

from edge_runtime.errors import ConfigError
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import LOG_FORMAT, End, LoggedObjectiveSet, Start, Tick

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
    with pytest.raises(ConfigError, match=f"'cfpg-log/7', this version reads '{LOG_FORMAT}'"):
        list(read_log(path))


def test_a_missing_file_is_one_line(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        list(read_log(tmp_path / "none.mcap"))
