"""What the benchmark writes: a row a case, and a row a size of team."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path

import msgspec

from benchmarks.common.result_file import read_result, replaced, write_result
from benchmarks.common.result_page import table, table_head, table_line
from benchmarks.sil.cases import Case, Late
from edge_runtime.network.team_wire import FRAME_BYTES
from firmware_bridge.sil.report.records import SilReport

ATTEMPTS = 3
"""Runs of a case that only come late, or that the machine disturbs."""
STARVED = "no fresh command"
"""A guard says so whose runtime was not given the processor for its deadline, or did not take it."""
OVERHEAD_BYTES = 28
"""IPv4 and UDP headers."""


class CaseRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One line of the table of what must be seen."""

    name: str
    asked: str
    seen: str
    missing: tuple[str, ...]
    """What was asked for and not seen."""
    robots: int
    rate_hz: float
    disturbed: tuple[str, ...]
    """Why the machine was not quiet."""
    duration_s: float
    realtime: bool
    late_before: int = 0
    """Runs before this one that only came late or were disturbed, and were repeated."""


class Size(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One line of the table of growth: a robot's own is the mean of runtime, guard and logger.

    The share of ticks is the worst robot's, all cores are those of firmware and plant too, and what a robot
    sends counts with the headers of IP and UDP.
    """

    robots: int
    rate_hz: float
    neighbours: int
    disturbed: tuple[str, ...]
    achieved_rate_share: float
    cpu_cores: float
    cpu_cores_a_robot: float
    memory_mib_a_robot: float
    sent_bytes_a_second: float


class SilResults(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that was measured."""

    cores: int
    rows: tuple[CaseRow, ...]
    sizes: tuple[Size, ...]


def keep(path: Path, measured: SilResults) -> None:
    """Write results; rows and sizes of the file that were not measured again stay as they are."""
    old = read_result(path, SilResults, default=SilResults(measured.cores, (), ()))
    rows = replaced(old.rows, measured.rows, attrgetter("name"))
    sizes = replaced(old.sizes, measured.sizes, attrgetter("robots", "rate_hz"))
    write_result(path, SilResults(measured.cores, tuple(rows), tuple(sizes)))


def settled_row(case: Case, run: Callable[[], SilReport]) -> CaseRow:
    """Judge runs of a case until one tells something, ATTEMPTS at most; the last counts.

    A robot that is a moment late tells of its code or of who shares its machine: code is late again. So does
    one that its guard stopped for that, and nothing else that it then lacks tells more. What is no matter of
    time, such as a collision, is never tried twice on a quiet machine.
    """
    late_before, report = 0, run()
    while late_before + 1 < ATTEMPTS and _tells_nothing(case, report):
        late_before, report = late_before + 1, run()
    return msgspec.structs.replace(row_of(case, report), late_before=late_before)


def _tells_nothing(case: Case, report: SilReport) -> bool:
    missing = _missing(case, report)
    only_late = all(isinstance(words, Late) for words in missing)
    starved = any(STARVED in words for words in report.ended)
    return bool(missing) and (only_late or starved or bool(report.disturbed))


def _missing(case: Case, report: SilReport) -> tuple[str, ...]:
    """Return what was not seen; nobody may end whom nobody asked to."""
    return (*case.judge(report), *report.ended)


def row_of(case: Case, report: SilReport) -> CaseRow:
    """Judge one run."""
    return CaseRow(
        case.name,
        case.asked,
        case.show(report),
        tuple(map(str, _missing(case, report))),
        report.robots_count,
        report.rate_hz,
        report.disturbed,
        report.duration_s,
        report.machine.realtime,
    )


def size_of(report: SilReport, neighbours: int) -> Size:
    """Sum up one run of one size of team."""
    count = report.robots_count
    sent = sum(robot.sent_messages / max(robot.driven_s, 1e-9) for robot in report.robots) / count
    return Size(
        count,
        report.rate_hz,
        neighbours,
        report.disturbed,
        report.team.achieved_rate_share,
        report.team.cpu_cores,
        sum(robot.cpu_cores for robot in report.robots) / count,
        sum(robot.memory_mib for robot in report.robots) / count,
        sent * (FRAME_BYTES + OVERHEAD_BYTES),
    )


def failed(case: Case, words: str) -> CaseRow:
    """Return the row of a run that could not be carried to its end."""
    return CaseRow(case.name, case.asked, "-", (words,), case.robots, case.rate_hz, (), 0.0, case.realtime)


HEAD = table_head(["", "asked", "seen", ""])


def line(row: CaseRow) -> str:
    """Format a row as a line of a Markdown table under `HEAD`."""
    verdict = "not seen: " + "; ".join(row.missing) if row.missing else "yes"
    verdict += f", {'INVALID: ' * bool(row.missing)}machine disturbed" if row.disturbed else ""
    verdict += f", after {row.late_before} that only came late" if row.late_before else ""
    return table_line([row.name, row.asked, row.seen, verdict])


def sizes_table(sizes: Sequence[Size]) -> str:
    """Format sizes as a Markdown table."""
    header = "robots, rate Hz, neighbours, ticks %, cores, cores a robot, MiB a robot, kB/s a robot"
    lines = []
    for size in sizes:
        team = [f"{size.robots}", f"{size.rate_hz:g}", f"{size.neighbours}"]
        ticks, cores = f"{100 * size.achieved_rate_share:.2f}", f"{size.cpu_cores:.2f}"
        each = [f"{size.cpu_cores_a_robot:.3f}", f"{size.memory_mib_a_robot:.0f}"]
        lines.append([*team, ticks, cores, *each, f"{size.sent_bytes_a_second / 1e3:.1f}"])
    return table(header.split(", "), lines)
