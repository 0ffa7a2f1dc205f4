"""When robots stood, and what else happened."""

from collections import Counter
from collections.abc import Iterator
from itertools import groupby

from edge_runtime.recording.schema import Event
from edge_runtime.tools.report.digest import RunDigest
from edge_runtime.tools.report.page import chart
from edge_runtime.tools.report.page.document import Figure, Item, Note, Table
from edge_runtime.tools.report.team import TeamDigest

ROUTINE = ("start", "stop", "found", "recovered")
"""Events that need no mark."""
MOST_ROWS = 200


def items(team: TeamDigest) -> list[Item]:
    """The timeline and the events in words."""
    rows = [_name(run) for run in team.runs]
    spans = [span for run in team.runs for span in _stops(team, run)]
    marks = [
        (_name(run), _time_s(team, event), event.name)
        for run in team.runs
        for event in run.events
        if event.name not in (*ROUTINE, "fault")
    ]
    drawn = chart.timeline(rows, spans, marks, team.duration_s)
    found: list[Item] = [Figure(drawn, "Stretches in which a robot was commanded to rest, and events.")]
    told = sorted(
        ((_time_s(team, event), _name(run), event) for run in team.runs for event in run.events),
        key=lambda entry: entry[0],
    )
    table = [(f"{time_s:.2f}", name, event.name, event.message) for time_s, name, event in told]
    found += [Note(_unfamiliar(run)) for run in team.runs if any(run.unfamiliar)]
    found.append(Table(("time s", "robot", "event", "what"), table[:MOST_ROWS]))
    if len(table) > MOST_ROWS:
        found.append(Note(f"{len(table) - MOST_ROWS} later events are in the logs."))
    return found


def _stops(team: TeamDigest, run: RunDigest) -> Iterator[chart.Span]:
    times = team.times(run)
    row = 0
    for reason, stretch in groupby(run.stopped):
        first, row = row, row + len(list(stretch))
        if reason:
            yield chart.Span(
                _name(run), float(times[first]), float(times[min(row, len(times) - 1)]), "stopped"
            )


def _unfamiliar(run: RunDigest) -> str:
    counts = Counter(field for field in run.unfamiliar if field)
    fields = ", ".join(f"{field} {count}" for field, count in counts.most_common())
    outside = f"{counts.total()} of {len(run.unfamiliar)}"
    return f"{_name(run)}: {outside} observations were unlike training's: {fields}."


def _time_s(team: TeamDigest, event: Event) -> float:
    return event.timestamp.sec + 1e-9 * event.timestamp.nsec - team.zero_s


def _name(run: RunDigest) -> str:
    return f"robot {run.start.robot_id}"
