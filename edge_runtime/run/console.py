"""What a person sees of a run: one live line, and the summary."""

import contextlib
import os
import threading
from collections.abc import Iterator
from typing import TextIO

from edge_runtime.common.printable import printed
from edge_runtime.control.monitor import SETTLE_S, Monitor
from edge_runtime.control.rate import DeadlineGrid
from edge_runtime.control.stopping import Stopping, describe
from edge_runtime.run.run_report import RunReport

TERMINAL_INTERVAL_S = 0.1
PLAIN_INTERVAL_S = 1.0
UNSETTLED = f"not judged: the objectives changed less than {SETTLE_S:g} s before the end"


class LiveLine:
    """A line of status, rewritten in place on a terminal, a new one each second elsewhere.

    A context manager whose own thread writes: a terminal that takes no text (Ctrl-S) holds up that thread,
    never the run; a reader that goes away ends the text, never the run.
    """

    def __init__(self, stream: TextIO, robot_id: int, monitor: Monitor, grid: DeadlineGrid) -> None:
        self._stream, self._robot_id, self._monitor, self._grid = stream, robot_id, monitor, grid
        self._terminal = stream.isatty()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._show, name="live line", daemon=True)

    def __enter__(self) -> "LiveLine":
        """Begin to show."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the text; a thread that a terminal holds up is left behind."""
        self._over.set()
        self._thread.join(TERMINAL_INTERVAL_S)

    def _show(self) -> None:
        interval_s = TERMINAL_INTERVAL_S if self._terminal else PLAIN_INTERVAL_S
        form = "\r{}\x1b[K" if self._terminal else "{}\n"
        # The stream's own lock, held in a write that never ends, would hold up the end of the process too.
        with contextlib.suppress(OSError):
            descriptor = self._stream.fileno()
            pause_s = TERMINAL_INTERVAL_S
            while not self._over.wait(pause_s):
                os.write(descriptor, form.format(self._status()).encode())
                pause_s = interval_s
            if self._terminal:
                os.write(descriptor, b"\n")

    def _status(self) -> str:
        monitor = self._monitor
        own = monitor.robots[self._robot_id]
        reached = sum(map(monitor.reached, monitor.robots))
        # Under 80 columns, or a terminal would wrap the line and leave its head behind.
        return (
            f"{self._grid.next_s:5.1f} s  robot {self._robot_id}: goal {own.goal_distance_m:.2f} m, "
            f"nearest {own.min_separation_m:.2f} m; "
            f"{reached} of {len(monitor.robots)} there, {self._grid.misses} missed"
        )


def use_colour(stream: TextIO) -> bool:
    """Whether to colour text: on a terminal, unless NO_COLOR asks for none."""
    return stream.isatty() and not os.environ.get("NO_COLOR")


def summary(report: RunReport, *, colour: bool) -> str:
    """The report for a person, a fact a line."""
    report = printed(report)
    rows = [
        ("stopped", report.stop_reason + (", dry run: nothing was commanded" if report.dry_run else "")),
        ("objectives", _objectives(report)),
        ("goals", _goals(report, colour)),
        ("separation", _separation(report, colour)),
        ("speed", _speed(report, colour)),
        ("rate", f"{report.rate_hz:.2f} Hz of {report.nominal_rate_hz:g} Hz, {_misses(report)}"),
        ("tick", _tick(report)),
        (
            "faults",
            "; ".join(f"{reason}: {count} ticks" for reason, count in report.faults.items()) or "none",
        ),
        ("log", _log(report, colour)),
        *([("stopping", _stopping(report.stopping, colour))] if report.stopping else []),
    ]
    rows += [("complaint", text) for text in report.complaints]
    rows += [("team", text) for text in _doubted(report)]
    title = f"robot {report.robot_id}, policy {report.policy} ({report.backend}), bridge {report.bridge}"
    return "\n".join([title, *(f"  {name:<12}{text}" for name, text in rows)])


def _doubted(report: RunReport) -> Iterator[str]:
    """Name the robots that lied, or whose memory is damaged."""
    for robot_id, frames in report.fleet.doubted.items() if report.fleet else ():
        yield f"robot {robot_id} was kept out: {frames} frames as no robot in order sends them"


def _objectives(report: RunReport) -> str:
    if not report.objectives:
        return "none, the flow is unguided"
    return f"{', '.join(report.objectives)} (guidance {report.guidance_mode})"


def _goals(report: RunReport, colour: bool) -> str:
    robots = [
        f"robot {robot.robot_id} "
        + ("never seen" if robot.goal_distance_m is None else f"{robot.goal_distance_m:.3f} m")
        for robot in report.robots
    ]
    reached = sum(robot.goal_reached for robot in report.robots)
    verdict = _verdict(report.team_goals_reached, f"{reached} of {len(robots)} reached", colour)
    return f"{verdict}: {', '.join(robots)}"


def _separation(report: RunReport, colour: bool) -> str:
    if not report.settled:
        return UNSETTLED
    least, margin = report.min_separation_m, report.safety_margin_m
    if least is None:
        return "no other robot was seen"
    if margin is None:
        return f"{least:.3f} m at least"
    if least >= margin and (silent := _silent(report)):
        return f"{least:.3f} m at least among those heard, margin {margin:g} m; {silent}"
    return f"{least:.3f} m at least, margin {margin:g} m {_kept(least >= margin, colour)}"


def _speed(report: RunReport, colour: bool) -> str:
    if not report.settled:
        return UNSETTLED
    greatest, limit = report.max_speed_m_s, report.speed_limit_m_s
    if limit is None:
        return f"{greatest:.3f} m/s at most"
    if greatest <= limit and (silent := _silent(report)):
        return f"{greatest:.3f} m/s at most among those heard, limit {limit:g} m/s; {silent}"
    return f"{greatest:.3f} m/s at most, limit {limit:g} m/s {_kept(greatest <= limit, colour)}"


def _silent(report: RunReport) -> str:
    """Say of whom nothing was known for a time: no limit can be called kept then."""
    silent = [robot for robot in report.robots if robot.silent_s > 0.0]
    return ", ".join(f"robot {robot.robot_id} silent for {robot.silent_s:.1f} s" for robot in silent)


def _misses(report: RunReport) -> str:
    slots = report.ticks + report.deadline_misses
    text = f"{report.deadline_misses} of {slots} deadlines missed"
    return text + (f", {report.anytime_ticks} samples cut short" if report.anytime_ticks else "")


def _tick(report: RunReport) -> str:
    tick = report.tick_us
    stages = ", ".join(f"{name} {stage.p50 / 1e3:.2f}" for name, stage in report.stage_us.items())
    whole = f"p50 {tick.p50 / 1e3:.2f} ms, p99 {tick.p99 / 1e3:.2f} ms, max {tick.max / 1e3:.2f} ms"
    return f"{whole} (p50: {stages})"


def _log(report: RunReport, colour: bool) -> str:
    log = report.log
    if log is None:
        return "not recorded"
    text = f"{log.path}, {log.ticks} ticks" + (f", the newest of {log.files} files" if log.files > 1 else "")
    if not (log.lost or log.failure):
        return text
    return _verdict(False, f"{text}, {log.lost} lost: {log.failure or 'the logger was held up'}", colour)


def _stopping(stopping: Stopping, colour: bool) -> str:
    return _verdict(False, describe(stopping), colour) if stopping.too_long else describe(stopping)


def _kept(kept: bool, colour: bool) -> str:
    return _verdict(kept, "kept" if kept else "violated", colour)


def _verdict(good: bool, text: str, colour: bool) -> str:
    return f"\x1b[{32 if good else 31}m{text}\x1b[0m" if colour else text
