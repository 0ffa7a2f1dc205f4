"""What a person sees of a run."""

from collections.abc import Sequence

from edge_runtime.common.printable import printed
from edge_runtime.control.rate import Percentiles
from firmware_bridge.sil.report.records import (
    FaultDone,
    ObjectQuality,
    Quality,
    RobotQuality,
    SilReport,
    describe_stop,
)

_COLOURS = {"passed": 32, "failed": 31, "invalid": 33}


def table(report: SilReport, *, colour: bool) -> str:
    """Return the report as text: a line a robot, the team, the machine, the verdict."""
    report = printed(report)
    head = (
        "",
        "rate",
        "jitter ms",
        "missed",
        "pose to command ms",
        "message age ms",
        "violated",
        "collisions",
        "goal",
        "CPU",
        "MiB",
    )
    rows = [head, *(_row(f"robot {r.robot_id}", r) for r in report.robots), _row("team", report.team)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join([_title(report), *lines, "", *_notes(report), _verdict(report, colour)])


def _title(report: SilReport) -> str:
    scheduling = "real-time scheduling" if report.machine.realtime else "ordinary scheduling"
    return (
        f"{report.robots_count} robots, policy {report.policy}, bridge {report.bridge}, "
        f"{report.rate_hz:g} Hz, {report.duration_s:.1f} s, {scheduling}; "
        "ages and jitter p50 / p99 / p99.9 / max"
    )


def _row(name: str, quality: Quality) -> tuple[str, ...]:
    goal = f"{quality.goals_reached}"
    if isinstance(quality, RobotQuality):
        away_m = quality.goal_distance_m
        goal = "-" if away_m is None else "reached" if quality.goals_reached else f"{away_m:.2f} m away"
        goal += ", exempt" if quality.exempt else ""
    return (
        name,
        f"{quality.achieved_rate_share:.2%}",
        _distribution(quality.period_jitter_ms),
        f"{quality.deadline_misses} (burst {quality.longest_burst})",
        _distribution(quality.pose_to_command_age_ms),
        _distribution(quality.fleet_message_age_ms),
        f"{quality.objective_violations_share:.1%}",
        f"{quality.collisions}",
        goal,
        f"{quality.cpu_cores:.2f}",
        f"{quality.memory_mib:.0f}",
    )


def _distribution(values: Percentiles | None) -> str:
    if values is None:
        return "-"
    return f"{values.p50:.2f} / {values.p99:.2f} / {values.p99_9:.2f} / {values.max:.2f}"


def _notes(report: SilReport) -> list[str]:
    machine = report.machine
    lines = [
        f"machine: {machine.cores} cores, wake-up late by ms {_distribution(machine.wake_ms)}, "
        f"others took {machine.others_cpu_cores:.2f} cores"
    ]
    lines.append(f"misses: {_misses(report.robots)}")
    lines += [_object(each) for each in report.objects]
    if evidence := report.evidence:
        lines.append(f"made: {evidence.started_at}, cfpg-edge {evidence.version}, commit {evidence.commit}")
    lines += [f"fault: {fault.details}{_stops(fault)}" for fault in report.faults]
    return lines


def _object(one: ObjectQuality) -> str:
    best_m, end_m = one.least_goal_distance_m, one.goal_distance_m
    return f"{one.name}: {best_m:.3f} m from its goal at best, {end_m:.3f} at the end"


def _stops(fault: FaultDone) -> str:
    return "".join(f"; {told}" for told in map(describe_stop, fault.stops))


def _misses(robots: Sequence[RobotQuality]) -> str:
    pairs = [(robot.lacking_commands, robot.counted_misses) for robot in robots if not robot.exempt]
    known = [(lacking, counted) for lacking, counted in pairs if lacking is not None and counted is not None]
    agree = all(lacking == counted for lacking, counted in known)
    said = "both counts agree" if agree else "the counts differ"
    lacking, counted = (sum(column) for column in zip((0, 0), *known, strict=True))
    late = sum(robot.late_commands or 0 for robot in robots if not robot.exempt)
    return (
        f"the firmware lacked {lacking} commands, the loops counted {counted}: {said}; {late} more came late"
    )


def _verdict(report: SilReport, colour: bool) -> str:
    word = f"\x1b[{_COLOURS[report.verdict]}m{report.verdict}\x1b[0m" if colour else report.verdict
    reasons = (*(f"disturbed: {reason}" for reason in report.disturbed), *report.broken)
    return "\n".join([f"verdict: {word}", *(f"  {reason}" for reason in reasons)])
