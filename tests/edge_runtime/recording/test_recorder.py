"""Recording beside a loop: whoever is killed, the loop drives on and the log is there."""

import contextlib
import json
import os
import re
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
from msgspec.structs import replace
from waiting import HANG_S, until

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import make_guide
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.objectives import SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.recording.folder import run_name
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.recorder import Recorder
from edge_runtime.recording.schema import End, Event, LoggedObjectiveSet, Start
from edge_runtime.recording.wire import LogPlan
from edge_runtime.run.edge_run import main
from edge_runtime.run.loop import STAGES
from edge_runtime.tools.replay.edge_replay import main as replay


@pytest.fixture
def drive(tmp_path):
    """Starts a run at 50 Hz whose log goes to ``tmp_path``; ended with the test."""
    started = []

    def start(*flags):
        command = [sys.executable, "-m", "edge_runtime.run", "--robot-id", "0", "--rate", "50", "--stay"]
        process = subprocess.Popen(
            [*command, "--log-dir", str(tmp_path), *flags], stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def logger_of(process):
    """The process number of the only child."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    return int(until(lambda: children.read_text().split(), by=process)[0])


def log_in(folder, least_ticks, process):
    """The log in a folder, once so many ticks are in it."""

    def found():
        return next((path for path in folder.glob("*.mcap") if readable(path) > least_ticks), None)

    return until(found, by=process)


def readable(path):
    """How many ticks can be read of a log that is being written."""
    with contextlib.suppress(ConfigError):  # it has no beginning yet
        return len(ticks(path))
    return 0


def told_of(pid, what):
    """What the system tells of a process; nothing of one that has ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/{what}").read_text()
    return ""


def wait_for_end(pid):
    until(lambda: not (told := told_of(pid, "stat")) or " Z " in told)


def drive_on(process):
    """Wait while it ticks: it sleeps between two ticks."""

    def sleeps():
        return int(
            re.search(r"^voluntary_ctxt_switches:\s+(\d+)", told_of(process.pid, "status"), re.MULTILINE)[1]
        )

    before = sleeps()
    until(lambda: sleeps() > before + 50, by=process)


def test_killing_the_run_and_its_logger_leaves_what_was_written(drive, tmp_path):
    """Read by the MCAP library's own reader, to where the file ends; benchmarks measure what is lost."""
    process = drive("--duration", "600")
    logger = logger_of(process)
    path = log_in(tmp_path, 20, process)
    os.kill(logger, signal.SIGKILL)
    process.kill()
    process.wait()
    assert messages(path) > len(ticks(path)) > 20


def messages(path):
    count = 0
    with path.open("rb") as file, contextlib.suppress(EndOfFile, struct.error):  # how the library ends it
        for item in StreamReader(file).records:
            count += isinstance(item, Message)
    return count


def test_killing_the_run_alone_loses_nothing(drive, tmp_path):
    process = drive("--duration", "600")
    logger = logger_of(process)
    path = log_in(tmp_path, 10, process)
    process.kill()
    process.wait()
    wait_for_end(logger)
    *_, last = read_log(path)
    numbers = [tick.inputs.number for tick in ticks(path)]
    assert numbers == list(range(len(numbers)))
    assert not isinstance(last, Damage | End)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_logger_that_dies_or_hangs_leaves_the_loop_alone(drive, tmp_path, number):
    """A stopped logger loses ticks only once its socket is full, which is the system's to say."""
    process = drive("--duration", "600", "--json", str(tmp_path / "run.json"))
    logger = logger_of(process)
    path = log_in(tmp_path, 5, process)
    os.kill(logger, number)
    drive_on(process)
    process.send_signal(signal.SIGTERM)
    text, _ = process.communicate(timeout=HANG_S)
    if number == signal.SIGSTOP:
        os.kill(logger, signal.SIGKILL)
    report = json.loads((tmp_path / "run.json").read_bytes())
    assert process.returncode == 0
    assert report["stop_reason"] == "SIGTERM"
    assert "the logger died or hangs" in report["log"]["failure"]
    assert "the logger died or hangs" in text
    assert report["log"]["lost"] > 0 or number == signal.SIGSTOP
    assert isinstance(next(read_log(path)), Start)


def test_signals_meant_for_the_loop_do_not_end_its_logger(drive, tmp_path):
    """systemd sends SIGTERM to all processes of a unit at once."""
    process = drive("--duration", "600")
    logger = logger_of(process)
    path = log_in(tmp_path, 5, process)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(logger, number)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=HANG_S)
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


def test_a_run_that_never_began_leaves_no_log(tmp_path, capsys):
    """Its bridge could not be opened, after its log was."""
    flags = ["--bridge", "mavlink", "--mavlink", "udpin:127.0.0.1:1", "--log-dir", str(tmp_path)]
    assert main(["--robot-id", "0", *flags]) == 2
    assert capsys.readouterr().err
    until(lambda: not list(tmp_path.iterdir()))


def test_objectives_exchanged_in_a_run_are_in_its_log(tmp_path):
    """Each tick names the set that it followed, and is replayed with it."""
    fleet = load_fleet(DEFAULT_FLEET)
    mission = Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, 100.0)
    controller, grid, timing = mission.controller(0), DeadlineGrid(0.01), TimingRecord(STAGES)
    slower = replace(fleet.objective_set, objectives=(SpeedLimit(limit_m_s=0.05),))
    guides = [controller.guide, replace(make_guide(slower, mission.bundle.manifest.motion), version=7)]
    with Recorder(
        LogPlan(str(tmp_path), run_name(1, "20260101T000000Z", 0, 1), 10**8, 60.0, 10**9)
    ) as recorder:
        recorder.begin(mission, controller, grid, timing, bridge="none", dry_run=True)
        for number in range(20):
            controller.guide = guides[number // 10]
            timing.begin(time.monotonic())
            team = TeamState(RobotState(0, time.monotonic(), (0.0, 0.0), (0.2, 0.1)))
            observation = controller.observe(team)
            guided = controller.act(observation, team)
            command = controller.limit(guided, team, time.monotonic())
            for _ in STAGES:
                timing.lap()
            timing.end()
            recorder.record(time.monotonic(), team, observation, guided, command)
        report = recorder.end("done", failed=False)
    path = Path(report.path)
    records = list(read_log(path))
    assert (report.ticks, report.lost, report.failure) == (20, 0, "")
    assert [tick.inputs.objectives_version for tick in ticks(path)] == [0] * 10 + [7] * 10
    assert [len(tick.action.costs) for tick in ticks(path)] == [2] * 10 + [1] * 10
    assert [item.version for item in records if isinstance(item, LoggedObjectiveSet)] == [0, 7]
    told = [item.message for item in records if isinstance(item, Event) and item.name == "objectives"]
    assert told[1] == "version 7: speed_limit (guidance terminal)"
    assert replay([str(path)]) == 0


@pytest.fixture
def hand_over(tmp_path):
    """A recorder, and what hands it so many ticks."""
    fleet = load_fleet(DEFAULT_FLEET)
    mission = Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, 100.0)
    controller, grid, timing = mission.controller(0), DeadlineGrid(0.01), TimingRecord(STAGES)
    team = TeamState(RobotState(0, time.monotonic(), (0.0, 0.0), (0.2, 0.1)))
    observation = controller.observe(team)
    guided = controller.act(observation, team)
    command = controller.limit(guided, team, time.monotonic())
    timing.begin(time.monotonic())
    for _ in STAGES:
        timing.lap()
    timing.end()
    with Recorder(
        LogPlan(str(tmp_path), run_name(1, "20260101T000000Z", 0, 2), 10**8, 60.0, 10**9)
    ) as recorder:
        recorder.begin(mission, controller, grid, timing, bridge="none", dry_run=True)

        def follow(count):
            for _ in range(count):
                recorder.record(time.monotonic(), team, observation, guided, command)

        yield recorder, follow


def test_ticks_for_a_dead_logger_are_lost(hand_over):
    recorder, follow = hand_over
    recorder._process.kill()
    recorder._process.wait()
    follow(4000)
    report = recorder.end("done", failed=False)
    assert (report.ticks, report.lost) == (0, 4000)
    assert "the logger died" in report.failure


def test_a_logger_that_hangs_holds_up_nothing_and_loses_only_what_had_no_room(hand_over):
    recorder, follow = hand_over
    os.kill(recorder._process.pid, signal.SIGSTOP)
    follow(20_000)
    assert 0 < recorder._lost < 20_000
    os.kill(recorder._process.pid, signal.SIGCONT)
    lost = recorder._lost
    until(lambda: follow(1) or recorder._number - recorder._lost > 20_000 - lost + 1000)
    report = recorder.end("done", failed=False)
    assert (report.ticks + report.lost, report.failure) == (recorder._number, "")
    files = sorted(Path(report.path).parent.glob("*.mcap"))
    numbers = [tick.inputs.number for path in files for tick in ticks(path)]
    assert numbers == sorted(set(numbers)) and len(numbers) == report.ticks


def test_no_log_writes_none(tmp_path, capsys):
    assert main(["--robot-id", "0", "--duration", "0.2", "--no-log", "--log-dir", str(tmp_path)]) == 0
    assert list(tmp_path.iterdir()) == []
    assert "not recorded" in capsys.readouterr().out
