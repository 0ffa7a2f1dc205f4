"""A run over several files: rotation, the cap on the disk, a disk that refuses."""

import errno
import fcntl
import itertools
import json
import os
import resource

import pytest
from logs import record, ticks
from waiting import HANG_S, until

from edge_runtime.recording import log_file, recorder
from edge_runtime.recording.folder import file_name, make_room, next_number, run_name
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.run_log import RunLog
from edge_runtime.recording.schema import End, LoggedObjectiveSet, Start, Tick
from edge_runtime.recording.wire import LogPlan
from edge_runtime.run.edge_run import main

RUN = run_name(1, "20260131T235959Z", 3, 7)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorded run as the logger was given it."""
    (path,) = record(tmp_path_factory.mktemp("run"))
    return [item for item in read_log(path) if isinstance(item, Start | LoggedObjectiveSet | Tick | End)]


def ticks_of(records):
    return [item for item in records if isinstance(item, Tick)]


def plan(folder, **limits):
    return LogPlan(str(folder), RUN, **({"file_bytes": 10**7, "file_s": 600.0, "keep_bytes": 10**8} | limits))


def write_run(run, plan, clock, flush_every=10):
    log = RunLog(plan, clock)
    log.files.open()
    for index, item in enumerate(run):
        log.write(item)
        if index % flush_every == 0:
            log.files.flush()
    log.files.close()
    return log.files.report()


@pytest.mark.parametrize("limits", [{"file_bytes": 15_000}, {"file_s": 3.0}])
def test_a_long_run_has_several_files_that_each_stand_by_themselves(run, tmp_path, limits):
    seconds = iter(range(10**6))
    report = write_run(run, plan(tmp_path, **limits), lambda: float(next(seconds)))
    paths = sorted(tmp_path.iterdir())
    assert report.files == len(paths) > 1
    assert report.path == str(paths[-1])
    for part, path in enumerate(paths):
        records = list(read_log(path))
        assert (records[0].part, records[0].run) == (part, run[0].run)
        assert any(isinstance(item, LoggedObjectiveSet) for item in records[:4])
        assert not isinstance(records[-1], Damage)
    assert [tick for path in paths for tick in ticks(path)] == [
        item for item in run if isinstance(item, Tick)
    ]


def test_the_oldest_logs_make_room_and_nothing_else_does(tmp_path):
    names = [file_name(run_name(number, "20260101T000000Z", 0, 9 - number), 0) for number in range(1, 6)]
    others = ["notes.txt", "20260101T000000Z_robot0_camera.mcap", "a.mcap"]
    for name in (*names, *others):
        (tmp_path / name).write_bytes(bytes(1000))
    make_room(tmp_path, 2500)
    assert {path.name for path in tmp_path.iterdir()} == {*names[3:], *others}


def test_runs_are_ordered_by_their_number_whatever_the_clock_said(tmp_path):
    """A machine without a clock of its own starts in 1970; earlier versions had no numbers."""
    names = [
        "20260101T000000Z_robot0_ffffffff_000.mcap",
        "20260102T000000Z_robot0_00000000_000.mcap",
        file_name(run_name(3, "20260103T000000Z", 0, 5), 999),
        file_name(run_name(3, "20260103T000000Z", 0, 5), 1000),
        file_name(run_name(4, "19700101T000001Z", 0, 1), 0),
        file_name(run_name(1_000_000, "19700101T000000Z", 1, 0), 0),
    ]
    for name in names:
        (tmp_path / name).write_bytes(bytes(1000))
    for count in range(len(names), -1, -1):
        make_room(tmp_path, 1000 * count)
        assert {path.name for path in tmp_path.iterdir()} == set(names[len(names) - count :])


def test_every_run_has_a_greater_number_than_those_that_lie_in_its_folder(tmp_path):
    assert next_number(tmp_path / "missing") == next_number(tmp_path) == 1
    for name in ("20260101T000000Z_robot0_ffffffff_000.mcap", "000099_notes.mcap"):
        (tmp_path / name).touch()
    assert next_number(tmp_path) == 1
    for number in (7, 1_000_000, 3):
        (tmp_path / file_name(run_name(number, "20260101T000000Z", 0, 0), 0)).touch()
    assert next_number(tmp_path) == 1_000_001


def test_a_log_that_is_being_written_is_not_deleted(tmp_path):
    old, new = (tmp_path / file_name(run_name(number, "20260101T000000Z", 0, 0), 0) for number in (1, 2))
    for path in (old, new):
        path.write_bytes(bytes(1000))
    with old.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        make_room(tmp_path, 1000)
    assert [path.name for path in tmp_path.iterdir()] == [old.name]


def test_a_new_file_keeps_to_the_cap(run, tmp_path):
    for day in range(1, 6):
        (tmp_path / file_name(f"2026010{day}T000000Z_robot0_{day:08x}", 0)).write_bytes(bytes(10_000))
    write_run(run, plan(tmp_path, file_bytes=20_000, keep_bytes=45_000), lambda: 0.0)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 45_000 + 20_000
    assert names[0].startswith(RUN)
    assert names[-1].startswith(RUN) or "robot0_00000005" in names[-1]


@pytest.fixture
def small_disk(monkeypatch):
    """Full for the logger alone once a file has 50 kB, from its start on."""
    start = recorder.start_child

    def start_on_small_disk(*arguments, **options):
        connection, process = start(*arguments, **options)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (50_000, 50_000))
        return connection, process

    monkeypatch.setattr(recorder, "start_child", start_on_small_disk)
    monkeypatch.setattr(recorder, "CLOSING_S", HANG_S)


@pytest.mark.usefixtures("small_disk")
def test_a_disk_that_is_full_stops_the_log_but_not_the_loop(tmp_path, capfd):
    runs = itertools.count()

    def filled():
        """Whether the disk took ticks before it was full: on a busy machine all may come at once, or few."""
        folder = tmp_path / str(next(runs))
        flags = ("--duration", "3", "--log-dir", str(folder), "--json", str(tmp_path / "run.json"))
        assert main(["--robot-id", "0", "--rate", "100", *flags]) == 0
        report, output = json.loads((tmp_path / "run.json").read_bytes()), capfd.readouterr().out
        (path,) = folder.glob("*.mcap")
        kept = ticks(path)
        assert report["ticks"] == report["log"]["ticks"] + report["log"]["lost"]
        assert [tick.inputs.number for tick in kept] == list(range(report["log"]["ticks"]))
        assert path.stat().st_size <= 50_000
        full = report["log"]["lost"] > 0
        assert ("File too large" in report["log"]["failure"]) == ("File too large" in output) == full
        return kept and full

    until(filled)


def test_a_disk_that_takes_files_again_gets_a_new_one(run, tmp_path):
    now = [0.0]
    log = RunLog(plan(tmp_path / "gone"), lambda: now[0])
    (tmp_path / "gone").write_text("not a folder")
    log.files.open()
    for item in run[:20]:
        log.write(item)
    assert "gone" in log.files.report().failure
    (tmp_path / "gone").unlink()
    now[0] = 10.0
    log.files.flush()
    for item in run[20:]:
        log.write(item)
    log.files.close()
    report, (path,) = log.files.report(), (tmp_path / "gone").iterdir()
    lost = ticks_of(run[:20])
    assert report.lost == len(lost)
    assert [*lost, *ticks(path)] == ticks_of(run)
    assert isinstance(next(read_log(path)), Start)


def test_a_disk_that_takes_a_files_name_but_no_content_is_tried_again(run, tmp_path, monkeypatch):
    """A full disk does so; the name must be free for the next try."""
    now, full = [0.0], [True]
    write = log_file.os.write

    def refuse(descriptor, content):
        if full[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, content)

    monkeypatch.setattr(log_file.os, "write", refuse)
    log = RunLog(plan(tmp_path), lambda: now[0])
    log.files.open()
    for item in run[:20]:
        log.write(item)
    assert "No space left" in log.files.report().failure
    assert list(tmp_path.iterdir()) == []
    now[0], full[0] = 10.0, False
    log.files.flush()
    for item in run[20:]:
        log.write(item)
    log.close()
    (path,) = tmp_path.iterdir()
    assert ticks(path)[-1].inputs.number == ticks_of(run)[-1].inputs.number


def test_a_pipe_with_the_name_of_a_log_holds_nobody_up(tmp_path):
    pipe, log = (tmp_path / file_name(run_name(number, "20260101T000000Z", 0, 0), 0) for number in (1, 2))
    os.mkfifo(pipe)
    log.write_bytes(bytes(1000))
    make_room(tmp_path, 500)
    assert [path.name for path in tmp_path.iterdir()] == [pipe.name]
