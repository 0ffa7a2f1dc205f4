"""The verdict: each limit breaks by itself, a disturbed machine proves nothing, faults excuse robots."""

import msgspec
import pytest
from sil_reports import MACHINE, report, robot

from edge_runtime.control.rate import Percentiles
from edge_runtime.errors import ConfigError
from firmware_bridge.sil.judge.table import table
from firmware_bridge.sil.judge.verdict import broken_limits, disturbances
from firmware_bridge.sil.report.records import ObjectQuality, ProcessCost
from firmware_bridge.sil.scenario.limits import (
    DEFAULT_LIMITS,
    LimitsFile,
    MachineLimits,
    RunLimits,
    load_limits,
)

DEFAULTS = load_limits()


def test_a_run_within_its_limits_breaks_none():
    assert broken_limits(report(robot(0), robot(1)), DEFAULTS.run) == ()


LATE = Percentiles(5.0, 45.0, 50.0, 60.0)


@pytest.mark.parametrize(
    "changes, complaint",
    [
        ({"achieved_rate_share": 0.99}, "robot 1: 99.00% of the ticks, 99.50% needed"),
        ({"longest_burst": 3}, "robot 1: 3 deadlines missed in a row, 2 allowed"),
        (
            {"lacking_commands": 3, "counted_misses": 2},
            "robot 1: its firmware lacked 3 commands, its loop counted 2 misses",
        ),
        ({"pose_to_command_age_ms": LATE}, "robot 1: pose to command age 45.0 ms at p99, 20.0 ms allowed"),
        ({"fleet_message_age_ms": LATE}, "robot 1: fleet message age 45.0 ms at p99, 40.0 ms allowed"),
        ({"objective_violations_share": 0.06}, "robot 1: objectives broken 6.0% of the time, 5.0% allowed"),
        ({"collisions": 2}, "1 collisions, 0 allowed"),
        (
            {"goals_reached": 0, "goal_distance_m": 0.5},
            "1 of 2 goals reached (robot 1 0.50 m away)",
        ),
    ],
)
def test_each_limit_is_judged(changes, complaint):
    assert broken_limits(report(robot(0), robot(1, **changes)), DEFAULTS.run) == (complaint,)
    lenient = LimitsFile()
    assert broken_limits(report(robot(0), robot(1, **changes)), lenient.run) == ()


def test_a_load_is_to_come_to_its_goal_once():
    package = ObjectQuality("package", goal_distance_m=0.3, least_goal_distance_m=0.25, goal_reached=False)
    away = report(robot(0), objects=(package,))
    assert broken_limits(away, DEFAULTS.run) == ("package came no nearer than 0.25 m to its goal",)
    assert "package: 0.250 m from its goal at best, 0.300 at the end" in table(away, colour=False)
    assert broken_limits(away, RunLimits()) == ()
    there = msgspec.structs.replace(package, goal_reached=True)
    assert broken_limits(report(robot(0), objects=(there,)), DEFAULTS.run) == ()


def test_a_fault_excuses_its_robot_but_not_a_collision():
    struck = robot(1, exempt=True, achieved_rate_share=0.1, goals_reached=0, collisions=2)
    assert broken_limits(report(robot(0), struck), DEFAULTS.run) == ("1 collisions, 0 allowed",)


def test_a_process_that_died_breaks_the_run():
    died = "robot_1 ended with 1: no bus"
    assert broken_limits(report(robot(0), ended=(died,)), RunLimits()) == (died,)


def test_memory_may_grow_only_so_much():
    grown = ProcessCost(name="robot_0", cpu_cores=0.1, memory_mib=80.0, memory_growth_mib=1.5)
    limits = RunLimits(memory_growth_mib=1.0)
    assert broken_limits(report(robot(0), processes=(grown,)), limits) == (
        "robot_0 grew by 1.5 MiB, 1 MiB allowed",
    )


@pytest.mark.parametrize(
    "changes, reasons",
    [
        ({}, 0),
        ({"wake_ms": Percentiles(0.1, 2.1, 3.0, 4.0)}, 1),
        ({"wake_ms": None}, 1),
        ({"others_cpu_cores": 0.2}, 1),
        ({"wake_ms": None, "others_cpu_cores": 0.2}, 2),
    ],
)
def test_a_disturbed_machine_is_noticed(changes, reasons):
    machine = msgspec.structs.replace(MACHINE, **changes)
    assert len(disturbances(machine, DEFAULTS.machine)) == reasons
    assert disturbances(machine, MachineLimits()) == ()


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("[run]\nspeed = 1.0", "run.speed: unknown key; allowed: achieved_rate_share"),
        ("[run]\ncollisions = 0.5", "run.collisions: Expected `int"),
        ("[machine]\nwake_p99_ms = -1.0", "machine: .*must not be negative"),
        ("[machine]\nwake_p99_ms = inf", "must be a finite number"),
        ("[walk]", "walk: unknown key; allowed: run, machine"),
        ("", "run: names no limit, so nothing could fail; allowed: achieved_rate_share"),
        ("[machine]\nwake_p99_ms = 1.0", "run: names no limit"),
    ],
)
def test_a_limits_file_is_checked(tmp_path, text, complaint):
    path = tmp_path / "limits.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        load_limits(path)


def test_the_packaged_limits_ask_for_what_the_table_promises():
    run, machine = DEFAULTS.run, DEFAULTS.machine
    assert (run.achieved_rate_share, run.longest_burst, run.collisions) == (0.995, 2, 0)
    assert (run.pose_to_command_age_periods, run.fleet_message_age_periods) == (1.0, 2.0)
    assert machine.wake_p99_ms is not None and machine.others_cpu_cores is not None
    assert DEFAULT_LIMITS.name == "limits.toml"


def test_the_table_says_whether_both_ends_count_the_same_misses():
    fine, lost = (
        robot(0, lacking_commands=2, counted_misses=2, late_commands=5),
        robot(1, lacking_commands=1, counted_misses=0),
    )
    silent = robot(2, exempt=True, lacking_commands=9, counted_misses=0)
    shown = table(report(fine, robot(1), silent), colour=False)
    assert "misses: the firmware lacked 2 commands, the loops counted 2: both counts agree; 5 more" in shown
    shown = table(report(fine, lost), colour=False)
    assert "misses: the firmware lacked 3 commands, the loops counted 2: the counts differ" in shown


def test_the_table_shows_robots_team_and_verdict():
    shown = table(report(robot(0), robot(1, exempt=True), verdict="failed", broken=("why",)), colour=False)
    lines = shown.splitlines()
    assert "real-time scheduling" in lines[0]
    assert [line.split()[0] for line in lines[2:5]] == ["robot", "robot", "team"]
    assert lines[-2:] == ["verdict: failed", "  why"]
    assert "\x1b[31mfailed" in table(report(robot(0), verdict="failed"), colour=True)
