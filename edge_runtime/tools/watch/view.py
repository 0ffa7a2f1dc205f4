"""The team as tables for a terminal of 80 columns: robots, guidance, tick times, message ages."""

import time

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from edge_runtime.telemetry.status import Status
from edge_runtime.tools.watch import text
from edge_runtime.tools.watch.team import WatchedTeam

STYLES = {True: "green", False: "bold red", None: ""}


class TeamView:
    """The newest state of a team whenever it is printed.

    Args:
        team: what was heard.
        title: names the fleet.
        keys: what the keys do; empty where there are none.
    """

    def __init__(self, team: WatchedTeam, title: str, keys: str = "") -> None:
        self._team, self._title, self._keys = team, title, keys

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the tables."""
        statuses = [heard.status for heard in self._team.heard.values() if heard]
        yield self._heading(options.max_width)
        yield _robots(self._team)
        yield from _stop_reasons(self._team)
        yield from (Text(f"robot {each.robot_id}: {told}") for each in statuses if (told := text.body(each)))
        yield from (
            Text(f"robot {each.robot_id}: {text.unfamiliar(each)}", "yellow")
            for each in statuses
            if each.unfamiliar_ticks
        )
        if statuses:
            yield Group(Text(), _objectives(statuses))
            yield Group(Text(), _times(statuses))
            yield Group(Text(), _ages(statuses))

    def _heading(self, width: int) -> RenderableType:
        team = self._team
        talking = sum(not team.silent(robot_id) for robot_id in team.heard)
        dropped = sum(team.dropped.values())
        left = Text.assemble(
            (self._title, "bold"), f"  {talking} of {len(team.heard)} robots heard", overflow="ellipsis"
        )
        if dropped:
            causes = ", ".join(f"{count} {cause}" for cause, count in team.dropped.items())
            left.append(f"  dropped {causes}", "yellow")
        row = Table.grid(expand=True)
        row.add_column(no_wrap=True)
        row.add_column(justify="right", no_wrap=True)
        row.add_row(left, Text(f"{time.strftime('%H:%M:%S')}  {self._keys}".strip(), "dim"))
        row.width = width
        return row


def _robots(team: WatchedTeam) -> Table:
    table = _table("robot", "state", "goal m", "speed m/s", "nearest m", "rate Hz", "missed", "age s", "set")
    for robot_id, heard in team.heard.items():
        cells = [text.Cell(str(robot_id)), text.state(team, robot_id)]
        if heard:
            status = heard.status
            cells += [
                text.goal(status),
                text.speed(status),
                text.nearest(status),
                text.rate(status),
                text.missed(status),
                text.Cell(f"{team.age_s(heard):.1f}"),
                text.Cell(str(status.objectives_version)),
            ]
        table.add_row(*map(_styled, cells))
    return table


def _stop_reasons(team: WatchedTeam) -> list[Text]:
    """One line for each reason, with all whom it stops."""
    stopped: dict[str, list[str]] = {}
    for robot_id, heard in team.heard.items():
        if heard and heard.status.stop_reason and not (heard.status.ended or team.silent(robot_id)):
            stopped.setdefault(heard.status.stop_reason, []).append(str(robot_id))
    return [Text(f"stopped {', '.join(robots)}: {reason}", "red") for reason, robots in stopped.items()]


def _objectives(statuses: list[Status]) -> Table:
    """One column for each objective that any robot follows, by its place and name."""
    places = dict.fromkeys(
        (place, objective.name) for status in statuses for place, objective in enumerate(status.objectives)
    )
    table = _table("cost", *(name for _, name in places))
    for status in statuses:
        items = {(place, item.name): item for place, item in enumerate(status.objectives)}
        cells = [text.objective(items[place]) if place in items else text.Cell("-") for place in places]
        table.add_row(str(status.robot_id), *map(_styled, cells))
    return table


def _times(statuses: list[Status]) -> Table:
    stages = dict.fromkeys(stage for status in statuses for stage in status.stages)
    table = _table("p50/p99 ms", "tick", *stages, gap=1)
    for status in statuses:
        spans = (status.stages.get(stage) for stage in stages)
        cells = [text.milliseconds(span) if span else "-" for span in spans]
        table.add_row(str(status.robot_id), text.milliseconds(status.tick), *cells)
    return table


def _ages(statuses: list[Status]) -> Table:
    robots = sorted({robot_id for status in statuses for robot_id in status.ages_s})
    table = _table("age ms", *(f"of {robot_id}" for robot_id in robots))
    for status in statuses:
        ages = (status.ages_s.get(robot_id) for robot_id in robots)
        cells = ["-" if age_s is None else f"{1e3 * age_s:.0f}" for age_s in ages]
        table.add_row(str(status.robot_id), *cells)
    return table


def _table(*columns: str, gap: int = 2) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, gap, 0, 0))
    for index, column in enumerate(columns):
        table.add_column(column, no_wrap=True, justify="left" if index == 0 else "right", overflow="ellipsis")
    return table


def _styled(cell: text.Cell) -> Text:
    return Text(cell.text, STYLES[cell.good])
