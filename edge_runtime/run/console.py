"""What a person sees of a run: one live line, and the summary."""

import contextlib
import math
import os
import threading
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple, TextIO

from edge_runtime.common.printable import printable, printed
from edge_runtime.control.judgement import SETTLE_S, Judgement
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid
from edge_runtime.control.stopping import Stopping, describe
from edge_runtime.run.run_report import RunReport

TERMINAL_INTERVAL_S = 0.1
PLAIN_INTERVAL_S = 1.0
UNJUDGED: Final = f"not judged, it held for less than {SETTLE_S:g} s"
LONGEST_LINE: Final = 78
"""Characters: a terminal would wrap a longer line and leave its head behind."""


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
        begin = f"{self._grid.next_s:5.1f} s  robot {self._robot_id}"
        if why := monitor.stop_reason or monitor.withheld:
            text = f"{begin} stands: {printable(why)}"
            return text[:LONGEST_LINE] if self._terminal else text
        own = monitor.robots[self._robot_id]
        goal = f"goal {own.goal_distance_m:.2f} m, " if math.isfinite(own.goal_distance_m) else ""
        goal += "".join(f"{name} {away:.2f} m, " for name, away in monitor.objects.items())
        nearest = f"{own.min_separation_m:.2f} m" if math.isfinite(own.min_separation_m) else "-"
        there = f"{monitor.goals_reached} of {monitor.goals} there, " if monitor.goals else ""
        line = f"{begin}: {goal}nearest {nearest}; {there}{self._grid.misses} missed"
        unseen = f"; unseen {monitor.unfamiliar_now}" if monitor.unfamiliar_now else ""
        return line + unseen[: LONGEST_LINE - len(line)]


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
        ("unfamiliar", _unfamiliar(report)),
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
    if not report.goals:
        return "none, the team has no places to be at"
    aways = {f"robot {robot.robot_id}": robot.goal_distance_m for robot in report.robots if robot.has_goal}
    told = [
        f"{name} {'never seen' if away is None else f'{away:.3f} m'}"
        for name, away in (aways | report.objects).items()
    ]
    reached = f"{report.goals_reached} of {report.goals} reached"
    return f"{_verdict(report.team_goals_reached, reached, colour)}: {', '.join(told)}"


class _Row(NamedTuple):
    """One quantity in one judgement."""

    judgement: Judgement
    measured: float | None
    limit: float | None
    asked: str
    """The limit in words."""
    kept: bool


def _separation(report: RunReport, colour: bool) -> str:
    if report.min_separation_m is None:
        return "no other robot was seen"
    rows = []
    for one in report.judgements:
        least, margin = one.min_separation_m, one.safety_margin_m
        kept = least is None or margin is None or least >= margin
        rows.append(_Row(one, least, margin, f"margin {margin or 0.0:g} m", kept))
    return _by_sets(f"{report.min_separation_m:.3f} m at least", "m", rows, colour)


def _speed(report: RunReport, colour: bool) -> str:
    rows = []
    for one in report.judgements:
        greatest, limit = one.max_speed_m_s, one.speed_limit_m_s
        kept = limit is None or greatest <= limit
        rows.append(_Row(one, greatest, limit, f"limit {limit or 0.0:g} m/s", kept))
    return _by_sets(f"{report.max_speed_m_s:.3f} m/s at most", "m/s", rows, colour)


def _by_sets(whole: str, unit: str, rows: Sequence[_Row], colour: bool) -> str:
    """The extreme of the whole run, and what each set of objectives came to over its own time."""
    if len(rows) == 1:
        return _against(whole, rows[0], colour)
    return "; ".join([whole, *(f"set {row.judgement.version}: {_told(row, unit, colour)}" for row in rows)])


def _told(row: _Row, unit: str, colour: bool) -> str:
    if not row.judgement.judged_s:
        return UNJUDGED
    return (
        "nobody else was seen"
        if row.measured is None
        else _against(f"{row.measured:.3f} {unit}", row, colour)
    )


def _against(value: str, row: _Row, colour: bool) -> str:
    if row.limit is None or row.measured is None:
        return value
    if row.kept and row.judgement.silent_s:
        return f"{value} among those heard, {row.asked}; {_silent(row.judgement)}"
    return f"{value}, {row.asked} {_kept(row.kept, colour)}"


def _silent(judgement: Judgement) -> str:
    """Say of whom nothing was known for a time: no limit can be called kept then."""
    return ", ".join(
        f"robot {robot_id} silent for {silent_s:.1f} s" for robot_id, silent_s in judgement.silent_s.items()
    )


def _misses(report: RunReport) -> str:
    slots = report.ticks + report.deadline_misses
    text = f"{report.deadline_misses} of {slots} deadlines missed"
    return text + (f", {report.anytime_ticks} samples cut short" if report.anytime_ticks else "")


def _tick(report: RunReport) -> str:
    tick = report.tick_us
    stages = ", ".join(f"{name} {stage.p50 / 1e3:.2f}" for name, stage in report.stage_us.items())
    whole = f"p50 {tick.p50 / 1e3:.2f} ms, p99 {tick.p99 / 1e3:.2f} ms, max {tick.max / 1e3:.2f} ms"
    return f"{whole} (p50: {stages})"


def _unfamiliar(report: RunReport) -> str:
    """Say how many observations were unlike those of training, and what was in them."""
    if report.unfamiliar is None:
        return "not judged: the bundle does not say what the policy saw in training"
    fields = ", ".join(f"{field} {ticks}" for field, ticks in report.unfamiliar.items())
    outside = sum(report.unfamiliar.values())
    return f"{outside} of {report.ticks} observations" + (f": {fields}" if fields else "")


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
