"""The page of edge-sil's report, in the form of edge-report's."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.printable import printed
from edge_runtime.common.regular_file import read_regular
from edge_runtime.control.rate import Percentiles
from edge_runtime.errors import ConfigError
from edge_runtime.tools.report.page import chart
from edge_runtime.tools.report.page.document import Facts, Figure, Item, Note, Page, Section, Table, Verdict
from firmware_bridge.sil.report.records import (
    Evidence,
    ObjectQuality,
    Quality,
    RobotQuality,
    SilReport,
    describe_stop,
)

LARGEST_REPORT: Final = 1 << 24
"""Bytes."""


def load_page(path: Path) -> Page:
    """Read what ``edge-sil --json`` wrote, and compose its page.

    Raises:
        ConfigError: if the file cannot be read or is something else.
    """
    try:
        report = msgspec.json.decode(read_regular(path, LARGEST_REPORT), type=SilReport)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"{path}: is no report of this version's edge-sil --json ({error})") from error
    return make_page(printed(report))


def make_page(report: SilReport) -> Page:
    """Compose a run's page."""
    subtitle = (
        f"{report.robots_count} robots on {report.bridge}, {report.rate_hz:g} Hz, {report.duration_s:.1f} s, "
        f"policy {report.policy}{f', {report.evidence.started_at}' if report.evidence else ''}"
    )
    sections = (
        Section("What was broken", _broken(report)),
        Section("Robots", [_robots(report.robots), _rates(report)]),
        Section("Timing and ages", [_spans(report)]),
        Section("Faults", _faults(report)),
        Section("Stopped ticks and refused messages", _counts(report.robots)),
        Section("Processes and machine", [_processes(report), _machine(report)]),
        Section("Evidence", _evidence(report.evidence)),
    )
    return Page("In-the-loop run", subtitle, _verdicts(report), [each for each in sections if each.items])


def _verdicts(report: SilReport) -> list[Verdict]:
    team = report.team
    passed = {"passed": True, "failed": False, "invalid": None}[report.verdict]
    return [
        Verdict("Verdict", report.verdict, f"{len(report.broken)} limits broken", passed),
        Verdict("Rate", f"{team.achieved_rate_hz:.2f} Hz", f"least of all robots, of {report.rate_hz:g} Hz"),
        Verdict("Deadlines missed", str(team.deadline_misses), f"{team.longest_burst} in a row at most"),
        Verdict("Collisions", str(team.collisions), good=team.collisions == 0),
        Verdict("At their goals", f"{team.goals_reached} of {report.robots_count}"),
        *map(_carried, report.objects),
        Verdict("Objectives violated", f"{100 * team.objective_violations_share:.2f} %", "of the time"),
    ]


def _carried(one: ObjectQuality) -> Verdict:
    return Verdict(
        one.name, f"{one.least_goal_distance_m:.3f} m", "from its goal at best", good=one.goal_reached
    )


def _broken(report: SilReport) -> list[Item]:
    told = (*report.broken, *report.disturbed, *report.ended)
    return [Note(text, warning=True) for text in told]


def _robots(robots: Sequence[RobotQuality]) -> Table:
    rows = [
        (
            str(robot.robot_id),
            f"{robot.achieved_rate_hz:.2f}",
            str(robot.deadline_misses),
            "-" if robot.goal_distance_m is None else f"{robot.goal_distance_m:.3f}",
            "-" if robot.least_distance_m is None else f"{robot.least_distance_m:.3f}",
            f"{robot.greatest_speed_m_s:.3f}",
            str(robot.collisions),
            f"{robot.cpu_cores:.2f}",
            f"{robot.memory_mib:.0f}",
            robot.stop_reason,
        )
        for robot in robots
    ]
    head = (
        "robot",
        "rate Hz",
        "missed",
        "goal m",
        "nearest m",
        "speed m/s",
        "collisions",
        "cores",
        "MiB",
        "stopped",
    )
    return Table(head, rows)


def _rates(report: SilReport) -> Figure:
    shares = {
        f"robot {robot.robot_id}": {"share": 100 * robot.achieved_rate_share} for robot in report.robots
    }
    return Figure(chart.bars(shares, "commands at the firmware, % of the rate"), "Share of the control rate.")


def _spans(report: SilReport) -> Table:
    rows = []
    named: list[tuple[str, Quality]] = [(f"robot {robot.robot_id}", robot) for robot in report.robots]
    for name, quality in (*named, ("team", report.team)):
        for what, span in (
            ("jitter of the period", quality.period_jitter_ms),
            ("pose to command", quality.pose_to_command_age_ms),
            ("messages when taken", quality.fleet_message_age_ms),
            ("states used", quality.fleet_used_age_ms),
        ):
            if span is not None:
                rows.append((name, what, *_cells(span)))
    return Table(("whose", "what", "p50 ms", "p99 ms", "p99.9 ms", "max ms"), rows)


def _cells(span: Percentiles) -> tuple[str, ...]:
    return tuple(f"{value:.2f}" for value in (span.p50, span.p99, span.p99_9, span.max))


def _faults(report: SilReport) -> list[Item]:
    rows = [f"robot {robot.robot_id}" for robot in report.robots]
    halts = [
        chart.Span(f"robot {robot.robot_id}", start_s, end_s, "at rest")
        for robot in report.robots
        for start_s, end_s in robot.halts_s
    ]
    marks = [(rows[0], fault.at_s, fault.kind) for fault in report.faults] if rows else []
    drawn = chart.timeline(rows, halts, marks, report.duration_s)
    table = [
        (
            f"{fault.at_s:.2f}",
            "-" if fault.for_s is None else f"{fault.for_s:.2f}",
            fault.kind,
            fault.details,
            "; ".join(map(describe_stop, fault.stops)),
        )
        for fault in report.faults
    ]
    caption = "When each robot was told to rest or told nothing; faults are marked on the first row."
    items: list[Item] = [Figure(drawn, caption)]
    return [*items, Table(("at s", "for s", "fault", "details", "stopped"), table)] if table else items


def _counts(robots: Sequence[RobotQuality]) -> list[Item]:
    rows = [
        (f"robot {robot.robot_id}", what, str(count), cause)
        for robot in robots
        for what, causes in (("stopped", robot.stopped_ticks), ("refused", robot.refused_messages))
        for cause, count in causes.items()
    ]
    return [Table(("robot", "what", "times", "cause"), rows)] if rows else []


def _processes(report: SilReport) -> Table:
    rows = [
        (each.name, f"{each.cpu_cores:.3f}", f"{each.memory_mib:.1f}", f"{each.memory_growth_mib:+.1f}")
        for each in report.processes
    ]
    return Table(("process", "cores", "MiB", "growth MiB"), rows)


def _machine(report: SilReport) -> Facts:
    machine = report.machine
    wake = "not measured" if machine.wake_ms is None else " / ".join(_cells(machine.wake_ms)) + " ms"
    return Facts(
        [
            ("cores", str(machine.cores)),
            ("real-time", "yes" if machine.realtime else "no"),
            ("wake p50/p99/p99.9/max", wake),
            ("taken by others", f"{machine.others_cpu_cores:.2f} cores"),
        ]
    )


def _evidence(evidence: Evidence | None) -> list[Item]:
    if evidence is None:
        return []
    facts = [
        ("started", evidence.started_at),
        ("command", shlex.join(evidence.command)),
        ("software", f"cfpg-edge {evidence.version}, commit {evidence.commit}"),
        ("versions", f"Python {evidence.python}, numpy {evidence.numpy}"),
        ("machine", evidence.machine),
        *((f"{name}, SHA-256", digest) for name, digest in evidence.sha256.items()),
    ]
    judged = [(key, f"{value:g}") for key, value in evidence.limits.items()]
    return [Facts(facts), Table(("limit", "value"), judged, "What the run was judged by.")]
