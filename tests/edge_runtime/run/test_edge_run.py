"""edge-run: the real process for exit codes, signals and files, a scripted robot for faults."""

import json
import math
import shlex
import signal
import subprocess
import sys
import types
from pathlib import Path

import pytest
from bundles import write_straight_bundle
from clocks import simulated_time
from networks import ENGINES
from waiting import HANG_S, until

from edge_runtime.common.signals import GRACE_S
from edge_runtime.errors import BridgeError, PolicyError
from edge_runtime.messages import RobotState
from edge_runtime.policy import backend
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import Event
from edge_runtime.run import edge_run as run
from edge_runtime.run.bridges import BRIDGES, BridgeModules
from firmware_bridge.simulation import bridge as sim

NEAR_FLEET = """
[[robots]]
id = 0
start_m = [0.0, 0.0]
goal_m = [0.3, 0.0]
[[robots]]
id = 5
start_m = [0.0, 0.6]
goal_m = [0.3, 0.6]
[[objectives]]
type = "speed_limit"
limit_m_s = 0.3
[[objectives]]
type = "safety_margin"
distance_m = 0.25
"""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return write_straight_bundle(tmp_path_factory.mktemp("policies") / "straight")


@pytest.fixture(scope="module")
def command(bundle):
    return [sys.executable, "-m", "edge_runtime.run", "--robot-id", "0", "--policy", str(bundle)]


def report_of(path):
    return json.loads(path.read_text())


@pytest.fixture
def simulated(bundle, capfd, tmp_path):
    """Run edge-run in this process, at once."""

    def run_simulated(*flags):
        flags = ["--policy", bundle, "--json", tmp_path / "run.json", *flags]
        with simulated_time():
            code = run.main(["--robot-id", "0", *map(str, flags)])
        return code, report_of(tmp_path / "run.json"), capfd.readouterr()

    return run_simulated


def test_a_run_ends_when_all_goals_are_held(simulated, tmp_path):
    (tmp_path / "fleet.toml").write_text(NEAR_FLEET)
    code, report, shown = simulated("--fleet", tmp_path / "fleet.toml", "--rate", "20")
    assert (code, shown.err) == (0, "")
    assert report["stop_reason"] == "goals held"
    assert report["goal_reached"] and report["team_goals_reached"]
    assert [robot["robot_id"] for robot in report["robots"]] == [0, 5]
    assert report["max_speed_m_s"] <= report["judgements"][0]["speed_limit_m_s"] == 0.3
    assert report["min_separation_m"] >= report["judgements"][0]["safety_margin_m"] == 0.25
    assert report["objectives"] == ["speed_limit", "safety_margin"]
    assert (report["robot_id"], report["bridge"]) == (0, "sim")
    assert report["backend"] in ("numpy", "compiled")
    assert "2 of 2 reached" in shown.out
    assert "margin 0.25 m kept" in shown.out
    assert "\x1b" not in shown.out


def test_duration_counts_whole_periods(command, tmp_path):
    flags = ["--rate", "50", "--duration", "0.5", "--no-guidance", "--json", tmp_path / "run.json"]
    done = subprocess.run([*command, *flags], capture_output=True, text=True, check=False)
    report = report_of(tmp_path / "run.json")
    assert (done.returncode, report["stop_reason"]) == (0, "duration")
    assert report["ticks"] <= 25 <= report["ticks"] + report["deadline_misses"]
    assert report["objectives"] == []
    assert report["judgements"][0]["speed_limit_m_s"] == 0.3
    assert list(report["stage_us"]) == ["wake", "read", "observe", "act", "limit", "write"]
    for stage in [report["tick_us"], *report["stage_us"].values()]:
        assert 0.0 <= stage["p50"] <= stage["p99"] <= stage["p99_9"] <= stage["max"] * (1 + 1e-6)
    assert "none, the flow is unguided" in done.stdout


@pytest.mark.parametrize("stay, reason", [((), "goals held"), (("--stay",), "duration")])
def test_a_robot_that_stays_holds_its_goal_until_the_duration_is_over(simulated, tmp_path, stay, reason):
    fleet = tmp_path / "still.toml"
    fleet.write_text("[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [0.0, 0.0]\n")
    _, report, _ = simulated("--fleet", fleet, "--duration", "1.5", *stay)
    assert report["stop_reason"] == reason


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_the_run_in_order(command, tmp_path, number):
    flags = ["--stay", "--json", tmp_path / "run.json"]
    with subprocess.Popen([*command, *flags], stdout=subprocess.PIPE, text=True) as process:
        assert "robot 0" in process.stdout.readline()
        process.send_signal(number)
        assert process.wait(timeout=HANG_S) == 0
    assert report_of(tmp_path / "run.json")["stop_reason"] == number.name


def test_a_reader_that_goes_away_does_not_end_the_run(command, tmp_path):
    flags = ["--duration", "1.5", "--json", tmp_path / "run.json"]
    with subprocess.Popen([*command, *flags], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.readline()
        process.stdout.close()
        assert (process.wait(timeout=HANG_S), process.stderr.read()) == (0, b"")
    assert report_of(tmp_path / "run.json")["stop_reason"] == "duration"


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's process table")
def test_the_process_stays_small(bundle):
    code = (
        "import sys; from edge_runtime.run.edge_run import main\n"
        "assert main(sys.argv[1:]) == 0\n"
        "print(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    )
    flags = ["--robot-id", "0", "--policy", bundle, "--rate", "100", "--duration", "0.5"]
    done = subprocess.run([sys.executable, "-c", code, *flags], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[-2]) < 60 * 1024


@pytest.mark.parametrize(
    "flags, expected",
    [
        ([], "the following arguments are required: --robot-id"),
        (["--robot-id", "9"], "navigation.toml: robots: none has id 9 (--robot-id); known ids: 0, 1, 2, 3"),
        (["--robot-id", "one"], "argument --robot-id: invalid int value: 'one'"),
        (["--robot-id", "0", "--bridge", "zigbee"], "invalid choice: 'zigbee' (choose from"),
        (["--robot-id", "0", "--rate", "nan"], "argument --rate: must be a number in [1, 1000], got 'nan'"),
        (["--robot-id", "0", "--rate", "0"], "argument --rate: must be a number in [1, 1000], got '0'"),
        (["--robot-id", "0", "--duration", "inf"], "argument --duration: must be a number in [0.001, 1e+09]"),
        (["--robot-id", "0", "--fleet", "/no/fleet.toml"], "/no/fleet.toml: cannot be read (No such file"),
        (["--robot-id", "0", "--objectives", "/no/o.toml"], "/no/o.toml: cannot be read (No such file"),
        (["--robot-id", "0", "--policy", "/no/bundle"], "/no/bundle: no such bundle directory"),
        (
            ["--robot-id", "0", "--json", "/no/run.json"],
            "--json /no/run.json: cannot be written (No such file",
        ),
        (["--robot-id", "0", "--seed", "9" * 23], "must be a whole number in [0, 9223372036854775807], got"),
        (["--robot-id", "0", "--seed", "-1"], "must be a whole number in [0, 9223372036854775807], got '-1'"),
        (["--robot-id", "0", "--fast"], "unrecognized arguments: --fast"),
    ],
)
def test_bad_input_is_one_line_and_nothing_starts(bundle, capsys, monkeypatch, flags, expected):
    monkeypatch.setattr(run, "run", lambda *_, **__: pytest.fail("started"))
    policy = [] if "--policy" in flags else ["--policy", str(bundle)]
    assert run.main([*flags, *policy]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("edge-run: ") and expected in err
    assert err.count("\n") == 1


def test_a_report_does_not_overwrite_what_is_read(bundle, tmp_path, capsys):
    slow = tmp_path / "slow.toml"
    slow.write_text('[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.1\n')
    before = slow.read_text()
    (tmp_path / "link.toml").symlink_to(slow)
    flags = ["--robot-id", "0", "--policy", str(bundle), "--json", str(slow)]
    for objectives in (slow, tmp_path / "link.toml"):
        assert run.main([*flags, "--objectives", str(objectives)]) == 2
        assert "slow.toml: would overwrite a file that is read" in capsys.readouterr().err
    assert slow.read_text() == before
    fleet = tmp_path / "fleet.toml"
    fleet.write_text(NEAR_FLEET)
    assert run.main([*flags, "--fleet", str(fleet), "--json", str(fleet)]) == 2
    assert fleet.read_text() == NEAR_FLEET


def test_the_process_exits_with_2(command):
    done = subprocess.run([*command, "--bridge", "zigbee"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


def test_a_damaged_bundle_is_refused(tmp_path, capsys):
    for name in ("manifest.json", "policy.npz", "policy.onnx"):
        copy = write_straight_bundle(tmp_path / name)
        content = bytearray((copy / name).read_bytes())
        content[len(content) // 2] ^= 1
        (copy / name).write_bytes(content)
        assert run.main(["--robot-id", "0", "--policy", str(copy)]) == 2
        assert name in capsys.readouterr().err


class ScriptedBridge:
    """A robot that reports what the script says, and keeps what it was told."""

    name = "scripted"
    poses = None
    max_speed_m_s = max_yaw_rate_rad_s = math.inf
    complaints = ()
    withholds = ""
    reaction = None

    def __init__(self, script, shut=False):
        self.shut = shut
        self.script, self.written, self.stops = iter(script), [], []

    def __enter__(self):
        if self.shut:
            raise BridgeError("no such bus")
        return self

    def __exit__(self, *_):
        self.stop("closed")

    def read(self):
        state = next(self.script)
        if isinstance(state, Exception):
            raise state
        return state(self.clock()) if callable(state) else state

    def teammates(self):
        return ()

    def ranges_m(self):
        return None

    def tracked(self):
        return ()

    def readings(self):
        return ()

    def write(self, command):
        self.written.append(command)

    def stop(self, reason):
        self.stops.append(reason)


def state(position=(0.0, 0.0), age_s=0.0):
    return lambda now_s: RobotState(0, now_s - age_s, position, (0.1, 0.0))


@pytest.fixture
def drive(bundle, monkeypatch, tmp_path):
    """Run edge-run in this process at 100 Hz against a script; one tick for each of its states."""

    def run_script(script, *flags, shut=False):
        bridge = ScriptedBridge(script, shut)
        module = types.SimpleNamespace(
            add_arguments=sim.add_arguments,
            options_from=sim.options_from,
            open_bridge=lambda *_: bridge,
        )
        monkeypatch.setitem(sys.modules, "scripted_bridge", module)
        monkeypatch.setitem(BRIDGES, "sim", BridgeModules("scripted_bridge", simulated=True))
        duration = f"{len(script) / 100:.2f}"
        flags = ["--rate", "100", "--duration", duration, "--json", str(tmp_path / "run.json"), *flags]
        with simulated_time() as bridge.clock:
            code = run.main(["--robot-id", "0", "--policy", str(bundle), *flags])
        return code, bridge, tmp_path / "run.json"

    return run_script


def actions(bridge):
    return [command.action for command in bridge.written]


def test_a_non_finite_state_commands_zero_in_its_own_tick(drive):
    code, bridge, path = drive([state(), state((math.nan, 0.0)), state()])
    assert code == 0
    first, second, third = bridge.written
    assert first.action != (0.0, 0.0) != third.action
    assert (second.action, second.velocity_m_s) == ((0.0, 0.0), (0.0, 0.0))
    assert report_of(path)["faults"] == {"the observation is not finite": 1}
    assert [command.sequence for command in bridge.written] == [0, 1, 2]


def test_a_stale_state_commands_zero(drive):
    _, bridge, path = drive([state(), state(age_s=5.0)])
    assert actions(bridge)[1] == (0.0, 0.0) != actions(bridge)[0]
    assert list(report_of(path)["faults"].values()) == [1]


def test_no_state_yet_commands_nothing(drive):
    _, bridge, path = drive([None, None, state()])
    assert len(bridge.written) == 1
    assert report_of(path)["faults"] == {"no own state yet": 2}


def test_a_run_that_never_knew_its_robot_has_failed(drive):
    """A vehicle that hears nothing of us, or whose estimator never starts."""
    code, bridge, path = drive([None, None, None])
    assert (code, bridge.written) == (1, [])
    assert report_of(path)["failed"]
    assert "own state was never known" in report_of(path)["stop_reason"]


def test_a_non_finite_gradient_commands_zero(drive, tmp_path):
    (tmp_path / "broken.py").write_text(
        "import math\nfrom edge_runtime.objectives import Objective, Slope\n"
        "class Broken(Objective, frozen=True, kw_only=True):\n"
        "    def evaluate(self, motion, outlook):\n        return Slope(0.0, math.nan)\n"
    )
    (tmp_path / "broken.toml").write_text("[[objectives]]\ntype = 'broken:Broken'")
    code, bridge, path = drive([state(), state()], "--objectives", str(tmp_path / "broken.toml"))
    assert (code, actions(bridge)) == (1, [(0.0, 0.0)] * 2)
    assert report_of(path)["faults"] == {"the gradient of Broken is not finite": 2}


def test_a_simulated_team_prepares_its_policy_once(bundle, tmp_path, monkeypatch):
    prepared, field = [], Bundle.field
    monkeypatch.setattr(Bundle, "field", lambda *asked: prepared.append(asked) or field(*asked))
    (tmp_path / "fleet.toml").write_text(NEAR_FLEET)
    flags = ["--fleet", str(tmp_path / "fleet.toml"), "--rate", "100", "--duration", "0.05", "--no-log"]
    assert run.main(["--robot-id", "0", "--policy", str(bundle), *flags]) == 0
    assert len(prepared) == 1


def test_the_end_of_a_run_stops_the_robot(drive):
    _, bridge, _ = drive([state(), state()])
    assert bridge.stops == ["duration", "closed"]


def test_what_the_firmware_complains_of_is_in_summary_report_and_log(drive, capfd):
    def complaining(now_s):
        ScriptedBridge.complaints = ("battery low", "remote control lost")
        return state()(now_s)

    try:
        code, bridge, path = drive([state(), complaining, state()])
    finally:
        ScriptedBridge.complaints = ()
    assert (code, len(bridge.written)) == (0, 3)
    report = report_of(path)
    assert report["complaints"] == ["battery low", "remote control lost"]
    assert capfd.readouterr().out.count("  complaint   battery low\n") == 1
    events = [record for record in read_log(Path(report["log"]["path"])) if isinstance(record, Event)]
    assert [event.message for event in events if event.name == "firmware"] == [
        "battery low",
        "remote control lost",
    ]


def test_a_dry_run_computes_but_commands_nothing(drive, capfd):
    code, bridge, path = drive([state(), state()], "--dry-run")
    assert (code, bridge.written) == (0, [])
    assert report_of(path)["ticks"] == 2
    assert "nothing was commanded" in capfd.readouterr().out


def test_a_link_that_fails_ends_the_run_stopped(drive, capsys):
    code, bridge, _ = drive([state(), BridgeError("the bus is gone"), state()])
    assert (code, bridge.stops) == (1, ["closed"])
    assert capsys.readouterr().err == "edge-run: the bus is gone\n"


def test_a_policy_that_fails_ends_the_run_stopped(drive, capsys, monkeypatch):
    def step(*_):
        raise PolicyError("the policy cannot be computed")

    monkeypatch.setattr(FlowPolicy, "step", step)
    monkeypatch.setattr(backend, "_check_finite", lambda _: None)  # as it is loaded it still can
    code, bridge, path = drive([state(), state()], "--backend", "numpy")
    assert (code, bridge.written, bridge.stops) == (1, [], ["closed"])
    assert capsys.readouterr().err == "edge-run: the policy cannot be computed\n"
    assert report_of(path)["failed"]


def test_a_link_that_does_not_open_starts_nothing(drive, capsys):
    code, bridge, _ = drive([state()], shut=True)
    assert (code, bridge.written, bridge.stops) == (2, [], [])
    assert capsys.readouterr().err == "edge-run: no such bus\n"


RAISING = """
import numpy as np
from edge_runtime.objectives import Objective, Slope
class Raising(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        return 1 / 0
class Unfinished(Objective, frozen=True, kw_only=True): ...
class Numpy(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        return np.float32(1.0), np.float32(0.5), np.int64(0), 0.0, np.float64(0.25)
class LeavesKeyboardInterrupt(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        raise KeyboardInterrupt
class LeavesSystemExit(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        raise SystemExit
class Uphill(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        return Slope(0.5 * (motion.x - 1.0) ** 2, d_x=1.0 - motion.x)
class LeavesGeneratorExit(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        raise GeneratorExit
"""
ENDLESS = """
from pathlib import Path
from edge_runtime.objectives import Objective
class Endless(Objective, frozen=True, kw_only=True):
    def evaluate(self, motion, outlook):
        Path({entered!r}).touch()
        while True:
            try:
                sum(range(1000))
            except Exception:
                continue
"""


def objectives_file(folder, name):
    (folder / "raising.py").write_text(RAISING)
    path = folder / "raising.toml"
    path.write_text(f"[[objectives]]\ntype = 'raising:{name}'")
    return str(path)


def test_an_objective_that_raises_stops_the_robot_in_that_tick(drive, tmp_path, capsys):
    code, bridge, path = drive([state(), state()], "--objectives", objectives_file(tmp_path, "Raising"))
    assert code == 1
    assert all(command.action == (0.0, 0.0) for command in bridge.written)
    fault = "objective Raising raised ZeroDivisionError: division by zero"
    assert report_of(path)["faults"] == {fault: 2}
    assert capsys.readouterr().err == f"edge-run: {fault}\n"


def test_a_wrong_slope_ends_the_run_where_slopes_are_checked(drive, tmp_path, capsys):
    """Without the check it drives on, away from what it is to reach."""
    asked = ["--objectives", objectives_file(tmp_path, "Uphill")]
    code, bridge, _ = drive([state(), state()], *asked)
    assert (code, len(bridge.written)) == (0, 2)
    capsys.readouterr()
    code, bridge, path = drive([state(), state()], *asked, "--check-gradients")
    assert (code, len(bridge.written), bridge.stops) == (1, 1, ["closed"])
    complaint = capsys.readouterr().err
    assert complaint.startswith("edge-run: Uphill: d cost / d x is stated as ")
    assert complaint == f"edge-run: {report_of(path)['stop_reason']}\n"


def test_what_is_hardly_meant_is_said_and_driven(drive, tmp_path, capsys):
    asked = tmp_path / "fast.toml"
    asked.write_text('[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 200')
    code, bridge, _ = drive([state(), state()], "--objectives", str(asked))
    assert (code, len(bridge.written)) == (0, 2)
    assert "edge-run: the speed limit of 200 m/s asks for nothing" in capsys.readouterr().err


@pytest.mark.parametrize("leaving", ["KeyboardInterrupt", "SystemExit", "GeneratorExit"])
def test_an_objective_that_leaves_does_not_take_the_loop_along(drive, tmp_path, leaving):
    code, bridge, path = drive(
        [state(), state()], "--objectives", objectives_file(tmp_path, f"Leaves{leaving}")
    )
    assert (code, len(bridge.written), bridge.stops) == (1, 2, ["duration", "closed"])
    assert list(report_of(path)["faults"]) == [f"objective Leaves{leaving} raised {leaving}: "]


def test_an_objectives_numbers_may_be_another_librarys(drive, tmp_path):
    code, bridge, _ = drive([state(), state()], "--objectives", objectives_file(tmp_path, "Numpy"))
    assert (code, len(bridge.written)) == (0, 2)
    assert {type(number) for command in bridge.written for number in command.action} == {float}


@pytest.mark.parametrize("ending", ["time", "signal"])
def test_an_objective_without_an_end_does_not_keep_the_run_from_its_own(command, tmp_path, ending):
    entered = tmp_path / "entered"
    (tmp_path / "endless.py").write_text(ENDLESS.format(entered=str(entered)))
    (tmp_path / "endless.toml").write_text("[[objectives]]\ntype = 'endless:Endless'")
    flags = ["--objectives", tmp_path / "endless.toml", "--no-log", "--json", tmp_path / "run.json"]
    flags += ["--duration", "0.1" if ending == "time" else "100000"]
    process = subprocess.Popen([*command, *flags], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    until(entered.exists)
    if ending == "signal":
        process.send_signal(signal.SIGTERM)
    _, said = process.communicate()
    why = "the end of its time" if ending == "time" else "SIGTERM"
    assert said == f"edge-run: objective Endless raised Overdue: still running {GRACE_S:g} s after {why}\n"
    assert process.returncode == 1
    report = report_of(tmp_path / "run.json")
    assert report["stop_reason"] == ("duration" if ending == "time" else "SIGTERM")


def test_an_objective_without_a_cost_is_refused(drive, tmp_path, capsys):
    code, bridge, _ = drive([state()], "--objectives", objectives_file(tmp_path, "Unfinished"))
    assert (code, bridge.written) == (2, [])
    assert "must define evaluate(motion, outlook)" in capsys.readouterr().err


def test_a_link_that_fails_is_in_the_report(drive):
    _, _, path = drive([state(), BridgeError("the bus is gone"), state()])
    report = report_of(path)
    assert (report["failed"], report["stop_reason"], report["ticks"]) == (True, "the bus is gone", 2)


@pytest.mark.parametrize("sink", [">&-", "> /dev/full"])
def test_a_lost_output_loses_only_the_text(command, sink, tmp_path):
    words = shlex.join([*map(str, command), "--duration", "0.3", "--json", str(tmp_path / "run.json")])
    done = subprocess.run(["bash", "-c", f"{words} {sink}"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert report_of(tmp_path / "run.json")["stop_reason"] == "duration"


@pytest.mark.parametrize("backend", ["numpy", "auto"])
def test_the_report_names_the_backend(command, backend, tmp_path):
    flags = ["--backend", backend, "--duration", "0.1", "--rate", "50", "--json", tmp_path / "run.json"]
    subprocess.run([*command, *flags], capture_output=True, text=True, check=True)
    allowed = ["numpy"] if backend == "numpy" else ["compiled" if ENGINES else "numpy"]
    assert [report_of(tmp_path / "run.json")["backend"]] == allowed


def test_an_early_wake_changes_nothing_but_the_timing(command, tmp_path):
    flags = ["--early-wake", "2", "--duration", "0.3", "--rate", "50", "--json", tmp_path / "run.json"]

    def some_in_time():
        subprocess.run([*command, *flags], capture_output=True, text=True, check=True)
        report = report_of(tmp_path / "run.json")
        late = report["faults"].pop("the robot's own state is not of the last 0.1 s", 0)  # on a busy machine
        assert report["faults"] == {}
        return late < report["ticks"]

    until(some_in_time)


def test_realtime_runs_or_names_the_missing_right(command):
    done = subprocess.run(
        [*command, "--realtime", "--duration", "0.1"], capture_output=True, text=True, check=False
    )
    refused = done.returncode == 2 and "was refused" in done.stderr and done.stderr.count("\n") == 1
    assert refused or (done.returncode, done.stderr) == (0, "")
