"""The real loop, from pose to command: edge-run processes with guard and logger, measured at the firmware.

What ``--loop`` prints. Each row is a run of edge-sil: four robots at 50 Hz, with real-time scheduling where
that is permitted.
"""

import sys

from benchmarks.common.result_page import table
from benchmarks.sil.cases import Case, pose_cases
from benchmarks.sil.run import run_case
from edge_runtime.control.rate import Percentiles
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.machine import realtime
from edge_runtime.errors import EdgeError
from firmware_bridge.sil.report.records import SilReport

STAGES = ("wake", "read", "observe", "act", "limit", "write")
HEAD = ["", "pose to command ms", "tick us", *(f"{stage} us" for stage in STAGES), "cores a robot", ""]


def measure(*, short: bool) -> tuple[str, bool]:
    """Return the table of all cases, p50 / p99 of the worst robot, and whether the machine was quiet."""
    permitted = realtime(wanted=True).verdict is Verdict.OK
    if not permitted:
        print("real-time scheduling is not permitted here: all rows run without", file=sys.stderr)
    rows, quiet = [], True
    for case in pose_cases():
        try:
            report = run_case(case, short=short, realtime=permitted)
        except EdgeError as error:
            rows.append([case.name, str(error), *[""] * (len(HEAD) - 2)])
            quiet = False
        else:
            rows.append(_row(case, report))
            quiet = quiet and not report.disturbed
    return table(HEAD, rows), quiet


def _row(case: Case, report: SilReport) -> list[str]:
    robots = report.robots
    stages = [_worst([robot.stage_us.get(stage) for robot in robots]) for stage in STAGES]
    cores = sum(robot.cpu_cores for robot in robots) / len(robots)
    ages = _worst([robot.pose_to_command_age_ms for robot in robots], digits=2)
    ticks = _worst([robot.tick_us for robot in robots])
    noise = f"INVALID: {'; '.join(report.disturbed)}" if report.disturbed else "the machine was quiet"
    return [case.name, ages, ticks, *stages, f"{cores:.3f}", noise]


def _worst(every: list[Percentiles | None], digits: int = 0) -> str:
    known = [one for one in every if one is not None]
    if not known:
        return "-"
    return f"{max(one.p50 for one in known):.{digits}f} / {max(one.p99 for one in known):.{digits}f}"
