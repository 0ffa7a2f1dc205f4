"""edge-doctor takes the command line of edge-run, touches nothing and tells by its exit code."""

import os
import pty
import subprocess
import sys
from contextlib import ExitStack

import pytest
from bundles import write_straight_bundle
from can_peers import Chassis, multicast_address
from fleet_processes import Process, robot
from waiting import until

from edge_runtime.doctor import edge_doctor as doctor
from edge_runtime.doctor.finding import fail, ok, warn
from edge_runtime.run.bridges import BRIDGES

ALONE = "[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [3.0, 1.0]\n"


@pytest.fixture
def alone(tmp_path):
    """Flags for a robot without a team."""
    (tmp_path / "alone.toml").write_text(ALONE)
    return ["--robot-id", "0", "--rate", "50", "--fleet", str(tmp_path / "alone.toml")]


@pytest.fixture
def bundle(tmp_path):
    return write_straight_bundle(tmp_path / "straight")


def verdicts(text):
    """The first word of each finding by the name of its check."""
    return {row[6:23].strip(): row[:5].strip() for row in text.splitlines()[:-1]}


def test_a_simulated_robot_has_nothing_that_fails(capsys):
    pytest.importorskip("onnxruntime")
    assert doctor.main(["--robot-id", "0"]) == 0
    found = verdicts(capsys.readouterr().out)
    assert list(found) == [
        *("versions", "real time", "kernel", "clock", "logs"),
        *("bundle", "parity", "backend", "numbers", "team"),
    ]
    assert "fail" not in found.values()


def test_a_chassis_is_looked_at_and_not_touched(alone, capsys, tmp_path):
    address, report = multicast_address(), tmp_path / "run.json"
    link = ["--bridge", "can", "--bus", address, "--profile", "agilex_v2", "--arm"]
    with Chassis(address) as chassis:
        code = doctor.main([*alone, *link, "--guard-deadline", "0.5", "--json", str(report)])
    found = verdicts(capsys.readouterr().out)
    assert list(found)[-5:] == ["team", "CAN interface", "feedback", "firmware timeout", "stopping"]
    assert set(list(found.values())[-5:]) == {"ok"}
    assert code == int("fail" in found.values())
    assert chassis.frames == []
    assert not report.exists()


def test_what_fails_is_a_line_and_exit_code_1(alone, capsys):
    link = ["--bridge", "can", "--bus", "no-such-interface0", "--profile", "agilex_v2"]
    assert doctor.main([*alone, *link]) == 1
    output = capsys.readouterr()
    found = verdicts(output.out)
    assert (found["CAN interface"], found["firmware timeout"], found["feedback"]) == ("fail", "ok", "fail")
    assert output.err == ""
    assert output.out.splitlines()[-1].startswith(f"{len(found)} checks: 2 failed")


def test_a_damaged_bundle_is_a_finding_beside_others(alone, bundle, capsys):
    (bundle / "policy.npz").write_bytes(b"damaged")
    assert doctor.main([*alone, "--policy", str(bundle)]) == 1
    output = capsys.readouterr().out
    assert verdicts(output)["bundle"] == "fail"
    assert "does not match its digest" in output
    assert "clock" in verdicts(output)


def test_a_directory_that_takes_no_report_fails(alone, capsys, tmp_path):
    assert doctor.main([*alone, "--json", str(tmp_path / "none" / "run.json")]) == 1
    assert verdicts(capsys.readouterr().out)["disk"] == "fail"


OWN = """
from edge_runtime.objectives import Objective, Slope
class Right(Objective, frozen=True, kw_only=True, tag="right"):
    def evaluate(self, motion, outlook):
        return Slope(0.5 * motion.vx**2, d_vx=motion.vx)
class Wrong(Objective, frozen=True, kw_only=True, tag="wrong"):
    def evaluate(self, motion, outlook):
        return Slope(0.5 * motion.vx**2, d_vx=-motion.vx)
class Raises(Objective, frozen=True, kw_only=True, tag="raises"):
    def evaluate(self, motion, outlook):
        raise SystemExit("no\\nmap")
class Never(Objective, frozen=True, kw_only=True, tag="never"):
    def evaluate(self, motion, outlook):
        return Slope(0.0)
"""


@pytest.mark.parametrize(("kind", "verdict", "said"), [
    ("Right", "ok", "right: slope and cost agree at"),
    ("Wrong", "fail", "wrong: d cost / d vx is stated as"),
    ("Raises", "fail", "objective raises raised SystemExit: no map"),
    ("Never", "warn", "never was never active"),
])  # fmt: skip
def test_slopes_of_own_objectives_are_compared(tmp_path, alone, capsys, kind, verdict, said):
    (tmp_path / "doctored.py").write_text(OWN)
    asked = tmp_path / "own.toml"
    asked.write_text(f'[[objectives]]\ntype = "doctored:{kind}"\n')
    doctor.main([*alone, "--objectives", str(asked)])
    output = capsys.readouterr()
    assert verdicts(output.out)["gradient"] == verdict
    assert said in output.out
    assert output.err == ""


def test_numbers_far_from_the_policys_are_a_warning(alone, capsys):
    doctor.main([*alone, "--rate", "500"])
    output = capsys.readouterr().out
    assert verdicts(output)["numbers"] == "warn"
    assert "the rate of 500 Hz is far from the 10 Hz" in output


def test_a_whole_fleet_is_looked_at_from_one_machine(tmp_path, capsys):
    """Two robots run, the third does not, and nobody listens to the second."""
    (tmp_path / "team.key").write_bytes(bytes(range(32)))
    (tmp_path / "team.key").chmod(0o600)
    path = tmp_path / "team.toml"
    only = "neighbours = [0]"
    path.write_text(
        '[carrier]\nkey = "team.key"\n' + robot(0, "neighbours = [2]") + robot(1, only) + robot(2, only)
    )
    with ExitStack() as stack:
        for robot_id in range(2):
            Process(path, robot_id, 0.0, stack).tick()

        def asked():
            """What it says once both have answered: on a busy machine one may be too slow."""
            assert doctor.main(["--whole-fleet", "--fleet", str(path)]) == 0
            output = capsys.readouterr().out
            found = verdicts(output)
            return output if found["answer of 0"] == found["answer of 1"] == "ok" else None

        output = until(asked)
    assert verdicts(output) == {
        **dict.fromkeys(("robot 0", "robot 1", "robot 2"), "ok"),
        "hearing": "warn",
        "answer of 0": "ok",
        "answer of 1": "ok",
        "answer of 2": "warn",
        "agreement": "ok",
    }
    assert "nobody listens to robot 1" in output
    assert "follows set 0: none" in output


def test_one_robot_or_the_whole_fleet(capsys):
    for flags in ([], ["--whole-fleet", "--robot-id", "0"]):
        assert doctor.main(flags) == 2
        assert "one of --robot-id and --whole-fleet is needed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--robot-id", "9"], "none has id 9"),
        (["--robot-id", "0", "--fleet", "nowhere.toml"], "nowhere.toml"),
        (["--robot-id", "0", "--bridge", "spi"], "invalid choice: 'spi'"),
        (["--robot-id", "0", "--frobnicate"], "--frobnicate"),
        (["--robot-id", "0", "--bridge", "can", "--profile", "agilex_v2"], "--bus"),
        (
            ["--robot-id", "0", "--rate", "50", "--bridge", "can", "--bus", "can0", "--profile", "tank"],
            "no such profile",
        ),
        (
            ["--robot-id", "0", "--bridge", "mavlink", "--mavlink", "udp", "--mavlink-autopilot", "px4"],
            "--mavlink 'udp'",
        ),
    ],
)
def test_bad_flags_are_one_line_and_exit_code_2(capsys, flags, said):
    assert doctor.main(flags) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("edge-doctor: ")
    assert output.err.count("\n") == 1
    assert said in output.err


@pytest.mark.parametrize("bridge", BRIDGES)
def test_the_help_is_that_of_edge_run_under_its_own_name(bridge, capsys):
    assert doctor.main(["--bridge", bridge, "--help"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("usage: edge-doctor ")
    assert "--no-guidance" in shown


def test_findings_are_counted(capsys):
    assert not doctor.show([ok("a"), warn("b", "c"), fail("d"), fail("e")], colour=False)
    assert capsys.readouterr().out.splitlines()[-1] == "4 checks: 2 failed, 1 warned"
    assert doctor.show([ok("a"), warn("b", "c")], colour=False)


@pytest.mark.parametrize(("no_color", "coloured"), [("", True), ("1", False)])
def test_only_terminals_that_want_it_see_colour(no_color, coloured):
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "edge_runtime.doctor", "--robot-id", "0"]
    subprocess.run(command, stdout=theirs, env={**os.environ, "NO_COLOR": no_color}, check=False)
    os.close(theirs)
    shown = os.read(ours, 65536)
    os.close(ours)
    assert (b"\x1b[" in shown) == coloured


def test_a_reader_that_goes_away_is_no_error():
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "edge_runtime.doctor", "--robot-id", "0"]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_an_interrupted_visit_is_not_a_clean_bill(monkeypatch, capsys):
    def interrupt(*_findings, **_colour):
        raise KeyboardInterrupt

    monkeypatch.setattr(doctor, "show", interrupt)
    assert doctor.main(["--robot-id", "0"]) == 130
    assert "not everything was checked" in capsys.readouterr().err
