"""The index of a log's chunks: whole in the file, small in memory."""

import time
import tracemalloc

import pytest
from logs import record, ticks, write
from mcap.reader import make_reader
from mcap.writer import Writer

from edge_runtime.recording.log_file import LogFile
from edge_runtime.recording.schema import TICK_CHANNELS


@pytest.fixture(scope="module")
def tick(tmp_path_factory):
    (path,) = record(tmp_path_factory.mktemp("run"))
    return ticks(path)[-1]


def add(file, tick):
    now = time.time_ns()
    for topic in TICK_CHANNELS:
        file.add(topic, getattr(tick, topic), now, tick.inputs.number)


def summary(path):
    with path.open("rb") as file:
        return make_reader(file).get_summary()


def test_a_file_has_the_index_that_the_library_keeps_by_itself(tmp_path, tick, monkeypatch):
    monkeypatch.setattr("time.time_ns", lambda: 10**18)
    packed = write(tmp_path / "packed.mcap", [tick] * 30, chunk_ticks=1)
    monkeypatch.setattr("edge_runtime.recording.log_file.PackedIndex", list)
    own = write(tmp_path / "own.mcap", [tick] * 30, chunk_ticks=1)
    assert packed.read_bytes() == own.read_bytes()
    assert len(summary(packed).chunk_indexes) == 30


def test_a_chunk_costs_less_than_half_a_kilobyte_of_memory(tmp_path, tick):
    assert hasattr(Writer(str(tmp_path / "any")), "_Writer__chunk_indices")  # what `LogFile` puts its own in
    file = LogFile(tmp_path / "log.mcap")
    tracemalloc.start()
    try:
        sizes = []
        for _ in range(2):
            for _ in range(200):
                add(file, tick)
                file.flush()
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
        file.close()
    assert sizes[1] - sizes[0] < 200 * 500
