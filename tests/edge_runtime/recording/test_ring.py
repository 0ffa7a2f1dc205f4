"""The ring between loop and logger: what comes out is what went in, and what has no room never half."""

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import edge_runtime.recording.ring as ring_module
from edge_runtime.recording.ring import Ring, open_ring_memory

SIZE = 104


def open_ends(size=SIZE):
    """The writer's end and the reader's."""
    memory = open_ring_memory(size)
    ends = Ring(memory), Ring(memory)
    os.close(memory)
    return ends


@pytest.fixture(autouse=True)
def _at_once(monkeypatch):
    monkeypatch.setattr(ring_module, "SETTLING_S", 0.0)


def taken(records):
    return [bytes(record) for record in records]


@settings(deadline=None)
@given(st.lists(st.one_of(st.none(), st.binary(max_size=SIZE)), max_size=60))
def test_it_is_a_queue_of_records_with_an_end(steps):
    """None takes, a record is put; the oracle is a list."""
    writer, reader = open_ends()
    held, used = [], 0
    for step in steps:
        if step is None:
            assert taken(writer.unread()) == held
            assert taken(reader.take()) == held
            held, used = [], 0
        else:
            need = 8 + 8 * -(-len(step) // 8)
            fits = used + need <= SIZE
            assert writer.put(step) == fits
            if fits:
                held.append(step)
                used += need
    assert taken(reader.take()) == held
    assert taken(reader.take()) == []
    writer.close()
    reader.close()


def test_what_was_written_outlives_its_writer():
    writer, reader = open_ends()
    writer.put(bytearray(b"last words"))
    writer.close()
    assert taken(reader.take()) == [b"last words"]
    reader.close()


def test_all_of_it_is_in_memory_from_the_start():
    """Nothing is left for the loop to touch first, and no process grows while it runs."""
    size = 64 * os.sysconf("SC_PAGE_SIZE")
    memory = open_ring_memory(size)
    blocks_before = os.fstat(memory).st_blocks
    ring = Ring(memory)
    assert blocks_before == 0
    assert 512 * os.fstat(memory).st_blocks >= size
    ring.close()
    os.close(memory)
