"""Recording beside a loop: whoever is killed, the loop drives on and the log is there."""

import contextlib
import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from logs import ticks
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader

from edge_runtime.log_reader import Damage, read_log
from edge_runtime.log_schema import End, Start
from edge_runtime.run import main

LOSS_S = 1.0


@pytest.fixture
def drive(tmp_path):
    """Starts a run at 100 Hz whose log goes to ``tmp_path``; ended with the test."""
    started = []

    def start(*flags):
        command = [sys.executable, "-m", "edge_runtime.run", "--robot-id", "0", "--rate", "100", "--stay"]
        process = subprocess.Popen(
            [*command, "--log-dir", str(tmp_path), *flags], stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def wait_for(condition, longest_s=30.0):
    end = time.monotonic() + longest_s
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


def logger_of(process):
    """The process number of the only child."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    return int(wait_for(lambda: children.read_text().split())[0])


def log_in(folder, least_bytes):
    """The log in a folder, once it has grown to a size."""
    return wait_for(lambda: next((p for p in folder.glob("*.mcap") if p.stat().st_size > least_bytes), None))


def wait_for_end(pid):
    wait_for(lambda: not Path(f"/proc/{pid}").exists() or " Z " in Path(f"/proc/{pid}/stat").read_text())


def test_killing_the_run_and_its_logger_loses_at_most_a_second(drive, tmp_path):
    """Read by the MCAP library's own reader, to where the file ends."""
    process = drive("--duration", "60")
    logger = logger_of(process)
    path = log_in(tmp_path, 80_000)
    killed_ns = time.time_ns()
    os.kill(logger, signal.SIGKILL)
    process.kill()
    process.wait()
    assert (killed_ns - max(message_times_ns(path))) * 1e-9 <= LOSS_S
    assert len(ticks(path)) > 50


def message_times_ns(path):
    times = []
    with path.open("rb") as file, contextlib.suppress(EndOfFile, struct.error):  # how the library ends it
        for item in StreamReader(file).records:
            if isinstance(item, Message):
                times.append(item.log_time)
    return times


def test_killing_the_run_alone_loses_nothing(drive, tmp_path):
    process = drive("--duration", "60")
    logger = logger_of(process)
    path = log_in(tmp_path, 50_000)
    process.kill()
    process.wait()
    wait_for_end(logger)
    *_, last = read_log(path)
    numbers = [tick.inputs.number for tick in ticks(path)]
    assert numbers == list(range(len(numbers)))
    assert not isinstance(last, Damage | End)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_logger_that_dies_or_hangs_leaves_the_loop_alone(drive, tmp_path, number):
    """A stopped logger loses ticks only once its socket is full."""
    process = drive("--duration", "2", "--json", str(tmp_path / "run.json"))
    logger = logger_of(process)
    path = log_in(tmp_path, 10_000)
    os.kill(logger, number)
    text, _ = process.communicate(timeout=30)
    if number == signal.SIGSTOP:
        os.kill(logger, signal.SIGKILL)
    report = json.loads((tmp_path / "run.json").read_bytes())
    assert process.returncode == 0
    assert report["stop_reason"] == "duration"
    assert "the logger died or hangs" in report["log"]["failure"]
    assert "the logger died or hangs" in text
    assert (report["log"]["lost"] > 0) == (number == signal.SIGKILL)
    assert isinstance(next(read_log(path)), Start)


def test_signals_meant_for_the_loop_do_not_end_its_logger(drive, tmp_path):
    """systemd sends SIGTERM to all processes of a unit at once."""
    process = drive("--duration", "60")
    logger = logger_of(process)
    path = log_in(tmp_path, 30_000)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(logger, number)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=30)
    *_, last = read_log(path)
    assert (last.stop_reason, last.lost) == ("SIGTERM", 0)


def test_a_folder_that_cannot_be_written_ends_the_run_before_it_begins(tmp_path, capsys):
    (tmp_path / "file").write_text("not a folder")
    assert main(["--robot-id", "0", "--log-dir", str(tmp_path / "file" / "logs")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "--log-dir" in captured.err
    assert "or --no-log" in captured.err
    assert captured.err.count("\n") == 1


def test_a_cap_without_room_is_refused(tmp_path, capsys):
    flags = ["--log-dir", str(tmp_path), "--log-file-mb", "10", "--log-keep-mb", "15"]
    assert main(["--robot-id", "0", *flags]) == 2
    assert "at least twice" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_no_log_writes_none(tmp_path, capsys):
    assert main(["--robot-id", "0", "--duration", "0.2", "--no-log", "--log-dir", str(tmp_path)]) == 0
    assert list(tmp_path.iterdir()) == []
    assert "not recorded" in capsys.readouterr().out
