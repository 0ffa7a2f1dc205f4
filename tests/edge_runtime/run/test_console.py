"""What a person reads: verdicts, colour only where it belongs."""

import io
import os
import pty
import select
import subprocess
import sys
import termios

import pytest
from bundles import write_straight_bundle
from msgspec.structs import replace
from waiting import HANG_S, until

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.judgement import Judgement
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid, Percentiles
from edge_runtime.control.stopping import Stopping, Travel
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.run.console import LiveLine, summary, use_colour
from edge_runtime.run.run_report import RobotReport, RunReport

SPAN = Percentiles(500.0, 900.0, 950.0, 1000.0)
REPORT = RunReport(
    robot_id=1,
    policy="navigation",
    backend="numpy",
    bridge="sim",
    dry_run=False,
    objectives=("speed_limit", "safety_margin"),
    guidance_mode="cone",
    ticks=99,
    rate_hz=9.9,
    nominal_rate_hz=10.0,
    deadline_misses=1,
    longest_miss_burst=1,
    anytime_ticks=2,
    faults={"the observation is not finite": 3},
    tick_us=SPAN,
    stage_us={"read": SPAN},
    goal_reached=True,
    team_goals_reached=False,
    min_separation_m=0.24,
    max_speed_m_s=0.29,
    safety_margin_m=0.25,
    speed_limit_m_s=0.3,
    judgements=(Judgement(0, 9.9, 0.24, 0.25, 0.29, 0.3, {}),),
    robots=(RobotReport(1, 0.05, True, 0.24, 0.29), RobotReport(2, None, False, None, 0.0)),
    goals=2,
    goals_reached=1,
    failed=False,
    fleet=None,
    stop_reason="duration",
)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def line(report, name, colour=False):
    (found,) = [row for row in summary(report, colour=colour).splitlines() if row.startswith(f"  {name}")]
    return found.removeprefix(f"  {name}").strip()


@pytest.mark.parametrize(("room_m", "colour"), [(None, ""), (0.2, ""), (0.1, "\x1b[31m")])
def test_stopping_is_a_number_and_red_where_the_margin_is_shorter(room_m, colour):
    stopping = Stopping(0.3, 2.0, (Travel("guard dead", 0.5, 0.17),), room_m)
    told = line(replace(REPORT, stopping=stopping), "stopping", colour=True)
    assert told.startswith(f"{colour}at 0.3 m/s, braking with 2 m/s^2: guard dead 0.17 m")
    assert ("less than after: guard dead" in told) == bool(colour)


def test_where_nothing_real_moves_nothing_is_said_of_stopping():
    assert "stopping" not in summary(REPORT, colour=False)


def test_every_fact_has_its_line():
    assert summary(REPORT, colour=False).startswith("robot 1, policy navigation (numpy), bridge sim\n")
    assert line(REPORT, "goals") == "1 of 2 reached: robot 1 0.050 m, robot 2 never seen"
    robots = tuple(replace(robot, has_goal=False) for robot in REPORT.robots)
    carried = replace(REPORT, robots=robots, goals=1, objects={"package": 0.3}, goals_reached=0)
    assert line(carried, "goals") == "0 of 1 reached: package 0.300 m"
    assert line(replace(carried, goals=0, objects={}), "goals") == "none, the team has no places to be at"
    assert line(REPORT, "separation") == "0.240 m at least, margin 0.25 m violated"
    assert line(REPORT, "speed") == "0.290 m/s at most, limit 0.3 m/s kept"
    assert line(REPORT, "rate") == "9.90 Hz of 10 Hz, 1 of 100 deadlines missed, 2 samples cut short"
    assert line(REPORT, "tick") == "p50 0.50 ms, p99 0.90 ms, max 1.00 ms (p50: read 0.50)"
    assert line(REPORT, "faults") == "the observation is not finite: 3 ticks"


def test_what_is_not_there_is_said():
    judgement = Judgement(0, 9.9, None, 0.25, 0.29, None, {})
    lone = replace(
        REPORT, min_separation_m=None, judgements=(judgement,), objectives=(), faults={}, dry_run=True
    )
    assert line(lone, "separation") == "no other robot was seen"
    assert line(lone, "speed") == "0.290 m/s at most"
    assert line(lone, "objectives") == "none, the flow is unguided"
    assert line(lone, "faults") == "none"
    assert line(lone, "stopped") == "duration, dry run: nothing was commanded"


def test_each_set_of_objectives_is_judged_for_itself():
    first = Judgement(0, 4.0, 0.282, 0.25, 0.29, 0.3, {})
    strict = Judgement(1, 3.0, 0.427, 0.45, 0.09, 0.1, {})
    last = Judgement(2, 0.0, None, 0.5, 0.0, None, {})
    report = replace(REPORT, min_separation_m=0.245, judgements=(first, strict, last))
    unjudged = "set 2: not judged, it held for less than 2 s"
    assert line(report, "separation") == (
        "0.245 m at least; set 0: 0.282 m, margin 0.25 m kept; "
        f"set 1: 0.427 m, margin 0.45 m violated; {unjudged}"
    )
    assert line(report, "speed") == (
        "0.290 m/s at most; set 0: 0.290 m/s, limit 0.3 m/s kept; "
        f"set 1: 0.090 m/s, limit 0.1 m/s kept; {unjudged}"
    )


def test_no_limit_is_called_kept_while_somebody_was_silent():
    judgement = Judgement(0, 9.9, 0.323, 0.25, 0.29, 0.3, {2: 8.0})
    unsure = replace(REPORT, min_separation_m=0.323, judgements=(judgement,))
    assert (
        line(unsure, "separation")
        == "0.323 m at least among those heard, margin 0.25 m; robot 2 silent for 8.0 s"
    )
    assert (
        line(unsure, "speed")
        == "0.290 m/s at most among those heard, limit 0.3 m/s; robot 2 silent for 8.0 s"
    )
    close = replace(judgement, min_separation_m=0.2)
    assert line(replace(unsure, judgements=(close,)), "separation").endswith("violated")


@pytest.mark.parametrize(("reason", "expected"), [
    ({}, "  0.0 s  robot 0: nearest -; 0 of 4 there, 0 missed"),
    ({"stop_reason": "robot 2 is silent"}, "  0.0 s  robot 0 stands: robot 2 is silent"),
    ({"withheld": "nobody armed it"}, "  0.0 s  robot 0 stands: nobody armed it"),
    ({"stop_reason": "a\x1b[2J" + "b" * 99}, "  0.0 s  robot 0 stands: a?[2J" + "b" * 48),
])  # fmt: skip
def test_the_live_line_says_why_a_robot_stands_in_one_line(reason, expected):
    monitor = Monitor(load_fleet(DEFAULT_FLEET), 1, 10, ObjectiveSet())
    for name, text in reason.items():
        setattr(monitor, name, text)
    controller, terminal = pty.openpty()
    with os.fdopen(terminal, "w") as stream, LiveLine(stream, 0, monitor, DeadlineGrid(0.1)):
        shown = b""
        while b"\x1b[K" not in shown:
            shown += os.read(controller, 65536)
    os.close(controller)
    assert shown.decode().partition("\x1b[K")[0].strip("\r\n") == expected


@pytest.mark.parametrize("name, code", [("separation", "\x1b[31m"), ("speed", "\x1b[32m")])
def test_verdicts_are_coloured(name, code):
    assert code in line(REPORT, name, colour=True)


def test_colour_belongs_to_terminals_that_want_it(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert use_colour(Terminal())
    assert not use_colour(io.StringIO())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not use_colour(Terminal())


def test_a_terminal_that_takes_no_text_holds_up_nothing(tmp_path):
    """Ctrl-S on the terminal of a run: it drives on, ends in time, and says so when text is taken again."""
    bundle = write_straight_bundle(tmp_path / "straight")
    report = tmp_path / "run.json"
    flags = ["--robot-id", "0", "--policy", bundle, "--rate", "50", "--duration", "1", "--json", report]
    controller, terminal = pty.openpty()
    termios.tcflow(terminal, termios.TCOOFF)
    with subprocess.Popen([sys.executable, "-m", "edge_runtime.run", *flags], stdout=terminal) as process:
        until(lambda: report.exists() and report.read_bytes(), by=process)  # written after the loop has ended
        assert process.poll() is None
        assert not select.select([controller], [], [], 0)[0]
        termios.tcflow(terminal, termios.TCOON)
        shown = b""
        while b"faults" not in shown:
            shown += os.read(controller, 65536)
        assert process.wait(timeout=HANG_S) == 0
    os.close(terminal)
    os.close(controller)
    assert b"stopped     duration" in shown
