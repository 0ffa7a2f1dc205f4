"""edge-sil: whole teams of real processes, short; what is judged here does not depend on how busy CI is."""

import hashlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from quiet import on_a_quiet_machine
from sil_reports import LENIENT, unstarved
from waiting import HANG_S, until

import edge_runtime
from edge_runtime import __version__
from edge_runtime.common.signals import StopSignals
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.sil import edge_sil as command
from firmware_bridge.sil.harness import harness, launch
from firmware_bridge.sil.harness.robots import check_robot
from firmware_bridge.sil.measurement.processes import ProcessGroup
from firmware_bridge.sil.scenario.faults import KINDS
from firmware_bridge.sil.scenario.scenario import Request, prepare
from firmware_bridge.sil.scenario.team_file import write_key

SIL = (sys.executable, "-m", "firmware_bridge.sil.edge_sil")
BUS_FAULTS = """
[[fault]]
kind = "duplicate"
at_s = 0.2
for_s = 1.0
share = 0.3
[[fault]]
kind = "reorder"
at_s = 0.2
for_s = 1.0
share = 0.3
hold_ms = 150
[[fault]]
kind = "corrupt_packets"
at_s = 1.2
for_s = 1.0
share = 0.3
[[fault]]
kind = "loss"
at_s = 1.2
for_s = 1.0
share = 0.3
[[fault]]
kind = "delay"
at_s = 1.2
for_s = 1.0
delay_ms = 30
[[fault]]
kind = "cpu_hog"
at_s = 1.2
for_s = 1.0
[[fault]]
kind = "hostile"
at_s = 2.2
for_s = 1.5
frames = 900
[[fault]]
kind = "corrupt_frames"
robot = 0
at_s = 1.0
for_s = 0.2
[[fault]]
kind = "kill"
at_s = 2.5
robot = 2
[[fault]]
kind = "kill"
part = "guard"
at_s = 3.0
robot = 1
[[fault]]
kind = "emergency_stop"
robot = 0
at_s = 4.4
for_s = 0.4
"""
AIR_FAULTS = """
[[fault]]
kind = "nan_pose"
robot = 0
at_s = 0.3
for_s = 0.2
[[fault]]
kind = "stale_pose"
robot = 1
at_s = 0.3
for_s = 0.3
[[fault]]
kind = "corrupt_frames"
robot = 2
at_s = 0.3
for_s = 0.3
[[fault]]
kind = "blackout"
at_s = 1.0
for_s = 2.0
[[fault]]
kind = "log_full"
at_s = 1.0
for_s = 1.0
[[fault]]
kind = "kill"
part = "logger"
robot = 0
at_s = 3.5
[[fault]]
kind = "freeze"
robot = 2
at_s = 4.2
for_s = 0.5
"""


ORDER = """
[[fault]]
kind = "objectives"
file = "slow.toml"
at_s = 0.2
"""


def started_by(folder):
    """Processes that have a run's folder among their arguments."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                line = (entry / "cmdline").read_bytes().decode()
            except OSError:
                continue
            if str(folder) in line:
                found.append(line.replace("\0", " "))
    return found


def await_none(folder):
    until(lambda: not started_by(folder), tell=lambda: started_by(folder))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "lenient.toml").write_text(LENIENT)
    (tmp_path / "slow.toml").write_text('[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.15\n')
    (tmp_path / "tmp").mkdir()
    return tmp_path


def run(folder, *flags, faults=""):
    (folder / "faults.toml").write_text(faults)
    flags = ["--rate", "10", *flags, "--limits", folder / "lenient.toml", "--json", folder / "run.json"]
    if faults:
        flags += ["--faults", folder / "faults.toml"]
    environment = {**os.environ, "TMPDIR": str(folder / "tmp")}
    done = subprocess.run(
        [*SIL, *map(str, flags)], check=False, capture_output=True, text=True, env=environment, timeout=HANG_S
    )
    assert started_by(folder / "tmp") == []
    assert list((folder / "tmp").iterdir()) == []
    report = (folder / "run.json").read_text()
    return done, json.loads(report) if report else None


@pytest.mark.integration
@on_a_quiet_machine
def test_a_team_drives_by_a_pose_stream(folder):
    flags = ("--robots", "2", "--rate", "5", "--duration", "1", "--pose-stream", "30")
    done, report = run(folder, *flags)
    assert (done.returncode, report["ended"]) == (0, []), done.stderr
    for robot in report["robots"]:
        assert 0.0 < robot["pose_to_command_age_ms"]["p50"] <= 100.0
        assert robot["tick_us"]["p50"] > 0.0
        assert set(robot["stage_us"]) == {"wake", "read", "observe", "act", "limit", "write"}


def test_a_team_drives_and_is_measured(folder):
    done, report = until(lambda: unstarved(run(folder, "--robots", "2", "--rate", "5", "--duration", "1")))
    assert (done.returncode, report["verdict"], report["ended"]) == (0, "passed", []), done.stderr
    assert [robot["robot_id"] for robot in report["robots"]] == [0, 1]
    assert {"world", "probe", "robot_0", "robot_1/guard", "harness"} <= {
        process["name"] for process in report["processes"]
    }
    evidence = report["evidence"]
    assert evidence["command"][:3] == ["edge-sil", "--rate", "10"]
    assert evidence["version"] == __version__
    assert evidence["sha256"]["policy"] == packaged_bundle("navigation").sha256
    assert evidence["sha256"]["limits"] == hashlib.sha256(LENIENT.encode()).hexdigest()
    assert f"made: {evidence['started_at']}, cfpg-edge {__version__}, commit" in done.stdout


@pytest.mark.integration
@on_a_quiet_machine
def test_a_team_on_can_through_every_fault_of_its_network(folder):
    done, report = run(folder, "--robots", "4", "--duration", "5", faults=BUS_FAULTS)
    assert done.returncode == 0, done.stderr
    assert report["verdict"] == "passed"
    assert [fault["kind"] for fault in report["faults"]][-3:] == ["kill", "kill", "emergency_stop"]
    robots = report["robots"]
    assert [robot["exempt"] for robot in robots] == [True, True, True, False]
    refused = robots[3]["refused_messages"]
    assert refused["duplicate"] and refused["reordered"] and refused["malformed"]
    # Forged frames are three quarters of the hostile ones, less those that were cut; a third of the honest
    # frames of one second had a bit changed as well.
    assert refused["foreign"] > 100
    assert robots[3]["halts_s"] == [] or robots[3]["halts_s"][-1][1] < 5.0
    assert robots[2]["stop_reason"] == "" and robots[2]["halts_s"][-1][1] == 5.0
    assert "guard ended" in robots[1]["stop_reason"]
    assert "an operator has the robot" in robots[0]["stop_reason"]
    assert robots[1]["firmware_timeouts"] == 1  # nobody was left to stop it but its own firmware
    assert report["ended"] == []
    stops = {(fault["kind"], one["robot_id"]): one for fault in report["faults"] for one in fault["stops"]}
    assert stops["kill", 1]["seconds"] > 0.3  # the firmware's timeout, from its last command on
    assert stops["kill", 2]["metres"] >= 0.0 and stops["corrupt_frames", 0]["seconds"] is not None
    assert "robot 1 at rest after" in done.stdout
    names = {process["name"] for process in report["processes"]}
    assert {"world", "probe", "relay", "robot_3", "robot_3/guard", "harness"} <= names
    assert any(name.startswith("hog_") for name in names)
    assert report["machine"]["wake_ms"]["max"] > 0.0


@pytest.mark.integration
@on_a_quiet_machine
def test_a_team_on_mavlink_through_faults_of_pose_and_air(folder):
    done, report = run(folder, "--robots", "3", "--bridge", "mavlink", "--duration", "8", faults=AIR_FAULTS)
    assert done.returncode == 0, done.stderr
    stopped = [robot["stopped_ticks"] for robot in report["robots"]]
    silent = "no teammate was heard for 1 s"
    assert all(ticks[silent] > 5 for ticks in stopped)
    for robot in (0, 1):
        assert stopped[robot].get("the robot's own state is not of the last 0.1 s", 0) > 0
        # It stopped in the blackout, and went on.
        assert any(begin < 3.0 < end < 4.5 for begin, end in report["robots"][robot]["halts_s"])
    frozen = report["robots"][2]
    assert frozen["exempt"] and "no fresh command" in frozen["stop_reason"]
    done_s = {fault["kind"]: fault["done_s"] for fault in report["faults"]}
    assert 1.0 <= done_s["log_full"] < 2.0 and 4.2 <= done_s["freeze"] < 5.0
    assert done_s["blackout"] is None
    assert {start for start, _ in report["robots"][0]["log_gaps_s"]} & {0.0} == set()
    assert report["robots"][0]["log_gaps_s"][-1][1] == 8.0  # its logger was killed, the robot drove on
    # Refused by the disk, its log began again when that was tried after 5 s.
    assert report["robots"][1]["log_gaps_s"] == [] or report["robots"][1]["log_gaps_s"][-1][1] < 8.0


@pytest.mark.integration
@on_a_quiet_machine
def test_a_users_fleet_is_moved_to_this_machine_and_takes_orders(folder):
    key = folder / "team.key"
    key.write_text("ab" * 32)
    key.chmod(0o600)
    (folder / "team.toml").write_text("""
        [team]
        policy = "navigation"
        [carrier]
        key = "team.key"
        [[robots]]
        id = 3
        start_m = [-0.5, 0.0]
        goal_m = [0.0, 0.3]
        address = "10.9.8.7:47000"
        [[robots]]
        id = 8
        start_m = [0.5, 0.0]
        goal_m = [0.6, 0.3]
        address = "10.9.8.8:47000"
    """)
    done, report = run(folder, "--fleet", folder / "team.toml", "--duration", "4", faults=ORDER)
    assert done.returncode == 0, done.stderr
    assert [robot["robot_id"] for robot in report["robots"]] == [3, 8]
    [(first_s, first)], [(second_s, second)] = (robot["objective_changes_s"] for robot in report["robots"])
    assert first == second == 1
    assert abs(first_s - second_s) < 0.2  # the grids of two robots are up to a period apart
    key.chmod(0o644)
    done, _ = run(folder, "--fleet", folder / "team.toml", "--duration", "1")
    assert done.returncode == 2 and "chmod 600" in done.stderr


@pytest.mark.integration
@on_a_quiet_machine
def test_a_team_on_zenoh_has_no_way_around_a_blackout(folder):
    pytest.importorskip("zenoh", reason="the extra `zenoh` is not installed")
    write_key(folder / "team.key")
    packaged = Path(edge_runtime.__file__).parent / "fleets" / "zenoh.toml"
    (folder / "team.toml").write_bytes(packaged.read_bytes())
    dark = '[[fault]]\nkind = "blackout"\nat_s = 0.5\nfor_s = 3.0\n'
    done, report = run(folder, "--fleet", folder / "team.toml", "--duration", "6", faults=dark)
    assert done.returncode == 0, done.stderr
    for robot in report["robots"]:
        assert robot["stopped_ticks"]["no teammate was heard for 1 s"] > 5
        assert any(begin < 3.5 < end < 6.0 for begin, end in robot["halts_s"])  # and it went on


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_the_harness(folder, number):
    environment = {**os.environ, "TMPDIR": str(folder / "tmp")}
    flags = ("--robots", "2", "--rate", "20", "--duration", "60")
    with subprocess.Popen([*SIL, *flags], stderr=subprocess.PIPE, text=True, env=environment) as harness:
        until(lambda: len(started_by(folder / "tmp")) >= 4, by=harness)
        harness.send_signal(number)
        _, words = harness.communicate(timeout=HANG_S)
    await_none(folder / "tmp")
    if number == signal.SIGINT:
        assert harness.returncode == 130
        assert words == "edge-sil: interrupted, nothing was judged\n"


def test_a_signal_among_the_starts_ends_them(folder):
    environment = {**os.environ, "TMPDIR": str(folder / "tmp")}
    with subprocess.Popen(
        [*SIL, "--robots", "8", "--rate", "20"], stderr=subprocess.PIPE, text=True, env=environment
    ) as harness:
        until(lambda: list((folder / "tmp").iterdir()), by=harness)
        harness.send_signal(signal.SIGTERM)
        _, words = harness.communicate(timeout=HANG_S)
    assert (harness.returncode, words) == (1, "edge-sil: ended by SIGTERM\n")
    assert list((folder / "tmp").iterdir()) == []
    await_none(folder / "tmp")


@pytest.mark.integration
@pytest.mark.parametrize("bridge", ["can", "mavlink"])
@on_a_quiet_machine
def test_no_robot_commands_anything_before_all_are_up(tmp_path, monkeypatch, bridge):
    """Its guard's deadline would run while its siblings, which still start, keep it from its ticks."""
    monkeypatch.setattr(launch, "APART_S", 2.5)
    scenario = prepare(Request(robots=2, bridge=bridge, rate_hz=10.0, duration_s=1.0), tmp_path)
    with StopSignals() as signals, ProcessGroup(tmp_path) as processes:
        recording = harness.Harness(scenario, processes, signals).run()
    first_s = [log.decided_s[0] for log in recording.logs.values()]
    assert abs(first_s[1] - first_s[0]) < 1.5
    assert all(report.faults["no own state yet"] for report in recording.reports.values())


def test_a_team_of_one(tmp_path):
    scenario = prepare(Request(robots=1), tmp_path)
    (station,) = scenario.stations
    check_robot(scenario, station)


@pytest.mark.parametrize(
    "flags, complaint",
    [
        (["--robots", "0"], "--robots: must be a whole number in [1, 64], got '0'"),
        (["--rate", "nan"], "--rate: must be a number in [1, 1000], got 'nan'"),
        (["--rate", "2"], "a control rate of 2 Hz is too slow"),
        (["--bridge", "pigeon"], "invalid choice: 'pigeon'"),
        (["--duration", "0"], "--duration: must be a number in [1, 1e+06], got '0'"),
        (["--fleet", "/no/team.toml"], "/no/team.toml: cannot be read"),
        (["--limits", "/no/limits.toml"], "/no/limits.toml: cannot be read"),
        (["--faults", "/no/faults.toml"], "/no/faults.toml: cannot be read"),
        (["--policy", "/no/bundle"], "/no/bundle: no such bundle directory"),
        (["--json", "/no/run.json"], "--json /no/run.json: cannot be written"),
        (["--log-dir", "/proc/x"], "--log-dir /proc/x: cannot be written"),
        (["--limits", "same.toml", "--json", "same.toml"], "--json same.toml: would overwrite a file"),
        (["--quick"], "unrecognized arguments: --quick"),
        (["--bridge", "ros1", "--realtime"], "--realtime: not with --bridge ros1"),
    ],
)
def test_bad_input_is_one_line_and_starts_nothing(flags, complaint, capsys, monkeypatch):
    monkeypatch.setattr(command, "ProcessGroup", lambda *_: pytest.fail("started"))
    assert command.main(flags) == 2
    words = capsys.readouterr().err
    assert complaint in words and words.startswith("edge-sil: ") and words.count("\n") == 1


def test_a_fleet_that_contradicts_the_flags_starts_nothing(tmp_path, capsys):
    alone = tmp_path / "alone.toml"
    alone.write_text("[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [0.5, 0.0]\n")
    assert command.main(["--fleet", str(alone)]) == 2
    assert "carrier: missing" in capsys.readouterr().err


def test_every_fault_is_seen_by_a_test():
    tried = BUS_FAULTS + AIR_FAULTS + ORDER + "clock_jump"  # the clock jumps in test_sil_clock.py
    assert [kind.__struct_config__.tag for kind in KINDS if kind.__struct_config__.tag not in tried] == []
