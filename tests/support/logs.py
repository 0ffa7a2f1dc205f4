"""Logs for tests: recorded by edge-run, or written record by record."""

import time

from clocks import simulated_time
from msgspec.structs import replace

from edge_runtime.recording.log_file import LogFile
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import TICK_CHANNELS, End, Event, LoggedObjectiveSet, Start, Tick
from edge_runtime.run.edge_run import main

TOPICS = {Start: "start", LoggedObjectiveSet: "objectives", Event: "events", End: "end"}


def record(folder, *flags):
    """Drive a short run without a miss and return the files of its log."""
    before = set(folder.glob("*.mcap"))
    duration = () if "--duration" in flags else ("--duration", "0.6")
    with simulated_time():
        assert main(["--robot-id", "0", "--rate", "100", "--log-dir", str(folder), *duration, *flags]) == 0
    return sorted(set(folder.glob("*.mcap")) - before)


def ticks(path):
    return [item for item in read_log(path) if isinstance(item, Tick)]


def write(path, records, chunk_ticks=50):
    """Write a log of these records; a chunk ends after so many ticks."""
    file, now = LogFile(path), time.time_ns()
    for item in records:
        assert not isinstance(item, Damage)
        if isinstance(item, Tick):
            for topic in TICK_CHANNELS:
                file.add(topic, getattr(item, topic), now, item.inputs.number)
            if item.inputs.number % chunk_ticks == chunk_ticks - 1:
                file.flush()
        else:
            file.add(TOPICS[type(item)], item, now)
    file.flush()
    file.close()
    return path


def with_tick(path, target, number, **changes):
    """Copy a log with parts of one tick exchanged: ``command=lambda command: ...``."""
    records = list(read_log(path))
    for index, item in enumerate(records):
        if isinstance(item, Tick) and item.inputs.number == number:
            parts = {name: change(getattr(item, name)) for name, change in changes.items()}
            records[index] = replace(item, **parts)
    return write(target, records)
