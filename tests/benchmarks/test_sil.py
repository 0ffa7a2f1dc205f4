"""``python -m benchmarks sil``: every row sees what it should, and notices where it is missing."""

import msgspec
import pytest
from msgspec.structs import replace
from sil_reports import report, robot

from benchmarks.sil.cases import cases, soak
from benchmarks.sil.rows import ATTEMPTS, SilResults, failed, keep, line, row_of, settled_row, size_of
from edge_runtime.control.rate import Percentiles
from edge_runtime.network.team_wire import FRAME_BYTES
from firmware_bridge.sil.report.records import FaultDone, ProcessCost

CASES = {case.name: case for case in (*cases(), soak())}
HALT = ((1.95, 4.05),)
YOUNG = {"pose_to_command_age_ms": Percentiles(0.7, 2.0, 2.5, 9.0)}
OLD = Percentiles(10.0, 50.0, 55.0, 61.0)
FULL = FaultDone(kind="log_full", at_s=10.0, for_s=1e6, details="", done_s=10.0)
GROWN = ProcessCost(name="robot_0", cpu_cores=0.1, memory_mib=80.0, memory_growth_mib=1.2)
DEAD = robot(3, exempt=True, goals_reached=0)
FOREIGN = {"foreign": 900, "malformed": 100}


def missing(name, *robots, **changes):
    return row_of(CASES[name], report(*robots, **changes)).missing


@pytest.mark.parametrize(
    "name, good, bad",
    [
        ("rate, CAN", {}, {"longest_burst": 3}),
        ("rate, MAVLink", {}, {"achieved_rate_share": 0.99}),
        (
            "rate, CAN, ordinary scheduling",
            {"lacking_commands": 9, "counted_misses": 9},
            {"lacking_commands": 9, "counted_misses": 8},
        ),
        (
            "rate, MAVLink, ordinary scheduling",
            {"lacking_commands": 0, "counted_misses": 0},
            {"lacking_commands": None},
        ),
        ("pose to command, CAN", YOUNG, {"pose_to_command_age_ms": OLD}),
        ("pose to command, MAVLink", YOUNG, {"pose_to_command_age_ms": None}),
        ("pose to command, CAN, poses at 120 Hz", YOUNG, {"pose_to_command_age_ms": OLD}),
        ("20 % packet loss", {}, {"fleet_message_age_ms": OLD}),
        ("20 % packet loss", {}, {"collisions": 2}),
        ("20 % packet loss, Zenoh", {}, {"fleet_message_age_ms": None}),
        ("3 s blackout", {"halts_s": HALT}, {"halts_s": ((1.95, 20.0),)}),
        ("3 s blackout", {"halts_s": HALT}, {"halts_s": HALT, "fleet_used_age_ms": OLD}),
        ("neighbour killed", {}, {"goals_reached": 0}),
        ("neighbour killed", {}, {"fleet_used_age_ms": OLD}),
        ("hostile frames", {"refused_messages": FOREIGN}, {"refused_messages": {}}),
        (
            "hostile frames",
            {"refused_messages": FOREIGN},
            {"refused_messages": FOREIGN, "accepted_messages": 101},
        ),
        ("objective swap under way", {"objective_changes_s": ((2.0, 1),)}, {"objective_changes_s": ()}),
        (
            "clock jump of an hour",
            {"lacking_commands": 0, "counted_misses": 0},
            {"lacking_commands": 1, "counted_misses": 1, "deadline_misses": 1},
        ),
        (
            "objective swap under way",
            {"objective_changes_s": ((2.0, 1),)},
            {"objective_changes_s": ((2.04, 1),)},
        ),
    ],
)
def test_a_row_sees_what_was_asked_for_and_what_is_missing(name, good, bad):
    healthy = [robot(index, **good) for index in range(2)]
    assert missing(name, *healthy) == ()
    assert missing(name, healthy[0], robot(1, **bad)) != ()


@pytest.mark.parametrize("gaps, lost", [(((9.5, 20.0),), False), (((8.5, 20.0),), True), ((), True)])
def test_at_most_a_second_of_log_is_lost(gaps, lost):
    robots = (robot(0, log_gaps_s=gaps), robot(1, log_gaps_s=((9.9, 20.0),)))
    assert bool(missing("log disk full", *robots, faults=(FULL,))) is lost


def test_the_soak_sees_growth_and_crashes():
    assert missing("soak, 8 robots", robot(0), processes=(GROWN,)) == ("robot_0 grew by 1.20 MiB",)
    small = ProcessCost(name="robot_0", cpu_cores=0.1, memory_mib=80.0, memory_growth_mib=0.2)
    assert missing("soak, 8 robots", robot(0), processes=(small,)) == ()
    assert missing("soak, 8 robots", robot(0), processes=(small,), ended=("robot_1 ended",)) != ()


def test_a_robot_that_its_guard_stopped_is_named_beside_its_poses():
    stopped = "robot_0 ended: the guard stopped the robot"
    assert missing("pose to command, MAVLink", robot(0, **YOUNG), ended=(stopped,)) == (stopped,)


def test_poses_are_asked_to_become_commands_within_3_ms_of_robots_with_real_time_scheduling():
    later = robot(0, pose_to_command_age_ms=Percentiles(1.0, 4.0, 5.0, 9.0))
    real_time = report(later).machine
    assert missing("pose to command, CAN", later) == ("robot 0: 4.0 ms",)
    assert missing("pose to command, CAN", later, duration_s=4.0) == ()
    assert missing("pose to command, CAN", later, machine=replace(real_time, realtime=False)) == ()


def test_a_disturbed_row_says_so():
    case = CASES["rate, CAN"]
    assert line(row_of(case, report(robot(0)))).endswith("| yes |")
    assert line(row_of(case, report(robot(0), disturbed=("busy",)))).endswith("| yes, machine disturbed |")
    assert "not seen: no plant" in line(failed(case, "no plant"))


@pytest.mark.parametrize(
    "name, late",
    [
        ("rate, CAN", {"longest_burst": 3}),
        ("pose to command, CAN", {"pose_to_command_age_ms": OLD}),
        ("20 % packet loss", {"fleet_message_age_ms": OLD}),
        ("clock jump of an hour", {"lacking_commands": 1, "counted_misses": 1, "deadline_misses": 1}),
    ],
)
def test_a_run_that_only_came_late_is_repeated_and_said_so(name, late):
    quiet = report(robot(0, lacking_commands=0, counted_misses=0, **YOUNG))
    runs = iter([report(robot(0, **late)), quiet])
    row = settled_row(CASES[name], lambda: next(runs))
    assert (row.missing, row.late_before) == ((), 1)
    assert line(row).endswith("| yes, after 1 that only came late |")
    runs = iter([report(robot(0, **late))] * ATTEMPTS)
    row = settled_row(CASES[name], lambda: next(runs))
    assert row.missing and row.late_before == ATTEMPTS - 1
    assert next(runs, None) is None


@pytest.mark.parametrize(
    "name, bad",
    [
        ("20 % packet loss", {"fleet_message_age_ms": OLD, "collisions": 2}),
        ("rate, CAN, ordinary scheduling", {"lacking_commands": 9, "counted_misses": 8}),
        ("neighbour killed", {"fleet_used_age_ms": OLD}),
        ("hostile frames", {"longest_burst": 3, "refused_messages": {}}),
        ("log disk full", {"longest_burst": 3}),
        ("pose to command, CAN", {"pose_to_command_age_ms": None}),
    ],
)
def test_what_is_no_matter_of_time_is_tried_again_only_if_the_machine_was_disturbed(name, bad):
    runs = iter([report(robot(0, **bad), faults=(FULL,))])
    row = settled_row(CASES[name], lambda: next(runs))
    assert row.missing and row.late_before == 0
    runs = iter([report(robot(0, **bad), faults=(FULL,), disturbed=("busy",))] * ATTEMPTS)
    row = settled_row(CASES[name], lambda: next(runs))
    assert line(row).count("INVALID: machine disturbed") == 1
    assert next(runs, None) is None


def test_a_run_whose_guards_were_starved_is_repeated_and_one_whose_robot_failed_is_not():
    case = CASES["neighbour killed"]
    stranded = robot(0, goals_reached=0, goal_distance_m=1.2)
    starved = "robot_0 ended with 1: edge-run: the guard stopped the robot: no fresh command for 60 ms"
    runs = iter([report(stranded, ended=(starved,)), report(robot(0))])
    row = settled_row(case, lambda: next(runs))
    assert (row.missing, row.late_before) == ((), 1)
    failing = "robot_0 ended with 1: edge-run: the policy's action is not finite"
    runs = iter([report(stranded, ended=(failing,))])
    row = settled_row(case, lambda: next(runs))
    assert row.missing == ("robot 0 did not arrive: 1.20 m away", failing) and row.late_before == 0


def test_traffic_counts_headers_and_the_time_that_a_robot_drove():
    size = size_of(report(robot(0, sent_messages=300, driven_s=10.0), robot(1, sent_messages=100)), 1)
    assert size.sent_bytes_a_second == pytest.approx((30 + 100 / 30) / 2 * (FRAME_BYTES + 28))


def test_what_was_not_measured_again_is_kept(tmp_path):
    path = tmp_path / "results" / "sil.json"
    first, second = (row_of(CASES[name], report(robot(0))) for name in ("rate, CAN", "rate, MAVLink"))
    size = size_of(report(robot(0)), 1)
    keep(path, SilResults(2, (first, second), (size,)))
    again = row_of(CASES["rate, MAVLink"], report(robot(0), disturbed=("busy",)))
    keep(path, SilResults(4, (again,), ()))
    assert msgspec.json.decode(path.read_bytes(), type=SilResults) == SilResults(4, (first, again), (size,))
