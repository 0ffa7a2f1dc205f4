"""One run's records as arrays over its ticks."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.common.printable import printable, printed
from edge_runtime.errors import ConfigError
from edge_runtime.recording.schema import End, Event, LoggedObjectiveSet, Record, StageTimes, Start, Tick

STAGES = StageTimes.__struct_fields__
GREATEST: Final = 1e12
"""Of any number that is drawn; what a log has beyond it, in whatever unit, nobody measured."""


@dataclass(frozen=True)
class RunDigest:
    """T ticks of one robot; what a tick did not have is NaN. All texts are printable."""

    start: Start
    sets: tuple[tuple[float, LoggedObjectiveSet], ...]
    """(time, what steered from then on)."""
    events: tuple[Event, ...]
    end: End | None
    """None if the log breaks off."""
    time_s: Floats
    """(T,), since 1970."""
    motion: dict[int, Floats]
    """(T, 4) by robot: position in m, velocity in m/s, as this robot knew them."""
    objects: dict[str, Floats]
    """(T, 2) by tracked object: position in m."""
    age_s: dict[int, Floats]
    """(T,) by teammate."""
    stage_us: Floats
    """(T, len(STAGES))."""
    misses: Floats
    """(T,), since the start."""
    stopped: tuple[str, ...]
    """(T,): why the command was zero, or empty."""
    unfamiliar: tuple[str, ...]
    """(T,): what the observation had that training never had, or empty."""
    costs: dict[str, Floats]
    """(T,) by objective."""
    conflicts: dict[str, Floats]
    """(T,) by objective: share of the sample's steps in which it pulled against another one."""
    projected: Floats
    """(T,): share of the sample's steps in which a projection changed the guidance."""
    cut: Floats
    """(T,): 1 where the deadline cut the sample."""


@dataclass
class _Columns:
    """What grows tick by tick."""

    time_s: list[float] = field(default_factory=list)
    motion: dict[int, dict[int, tuple[float, ...]]] = field(default_factory=dict)
    objects: dict[str, dict[int, tuple[float, ...]]] = field(default_factory=dict)
    age_s: dict[int, dict[int, float]] = field(default_factory=dict)
    stage_us: list[tuple[float, ...]] = field(default_factory=list)
    misses: list[float] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    unfamiliar: list[str] = field(default_factory=list)
    costs: dict[str, dict[int, float]] = field(default_factory=dict)
    conflicts: dict[str, dict[int, float]] = field(default_factory=dict)
    projected: list[float] = field(default_factory=list)
    cut: list[float] = field(default_factory=list)

    def add(self, tick: Tick, time_s: float, objectives: list[str]) -> None:
        row, action, steps = len(self.time_s), tick.action, max(1, tick.action.steps)
        self.time_s.append(time_s)
        for state in (tick.state.own, *(mate.state for mate in tick.state.teammates)):
            self.motion.setdefault(state.robot_id, {})[row] = (*state.position_m, *state.velocity_m_s)
        for each in tick.state.tracked:
            self.objects.setdefault(printable(each.name), {})[row] = each.position_m[:2]
        for mate in tick.state.teammates:
            self.age_s.setdefault(mate.state.robot_id, {})[row] = mate.age_s
        self.stage_us.append(tuple(getattr(tick.timing, stage) for stage in STAGES))
        self.misses.append(tick.inputs.misses)
        self.stopped.append(printable(tick.command.stop_reason))
        self.unfamiliar.append(printable(tick.observation.unfamiliar))
        for name, cost in zip(objectives, action.costs, strict=False):  # a refused sample has none
            self.costs.setdefault(name, {})[row] = cost
        for name, count in zip(objectives, action.conflicts, strict=False):
            self.conflicts.setdefault(name, {})[row] = count / steps
        self.projected.append(action.projections / steps)
        self.cut.append(float(action.cut))


def digest(records: Iterable[Record], name: str) -> RunDigest:
    """Gather one run's records, as its log has them in order.

    Raises:
        ConfigError: if there is no start; ``name`` is what the message calls the log.
    """
    start: Start | None = None
    end: End | None = None
    sets: list[tuple[float, LoggedObjectiveSet]] = []
    events: list[Event] = []
    columns, objectives, now_s = _Columns(), list[str](), 0.0
    for record in records:
        if isinstance(record, Start):
            start, now_s = start or printed(record), record.started_unix_s
        elif isinstance(record, LoggedObjectiveSet):
            record = printed(record)
            if not sets or sets[-1][1] != record:
                sets.append((columns.time_s[-1] if columns.time_s else now_s, record))
            objectives = active_names(record)
        elif isinstance(record, Tick) and start is not None:
            columns.add(record, start.started_unix_s + record.inputs.deadline_s - start.started_s, objectives)
        elif isinstance(record, Event):
            events.append(printed(record))
        elif isinstance(record, End):
            end = printed(record)
    if start is None:
        raise ConfigError(f"{name}: holds no run's start")
    return _arranged(start, tuple(sets), tuple(events), end, columns)


def active_names(chosen: LoggedObjectiveSet) -> list[str]:
    """Names of the objectives that steer, in the order of a sample's costs, each its own."""
    names = [item.name for item in chosen.objectives if item.active]
    return [
        f"{name} {names[:place].count(name) + 1}" if names.count(name) > 1 else name
        for place, name in enumerate(names)
    ]


def _arranged(
    start: Start,
    sets: tuple[tuple[float, LoggedObjectiveSet], ...],
    events: tuple[Event, ...],
    end: End | None,
    columns: _Columns,
) -> RunDigest:
    count = len(columns.time_s)
    return RunDigest(
        start,
        sets,
        events,
        end,
        np.array(columns.time_s),
        {robot: _filled(rows, count, 2 * start.fleet.dims) for robot, rows in sorted(columns.motion.items())},
        {name: _filled(rows, count, 2) for name, rows in columns.objects.items()},
        {robot: _filled(rows, count, 1)[:, 0] for robot, rows in sorted(columns.age_s.items())},
        _drawn(np.array(columns.stage_us, np.float64).reshape(count, len(STAGES))),
        np.array(columns.misses, np.float64),
        tuple(columns.stopped),
        tuple(columns.unfamiliar),
        {name: _filled(rows, count, 1)[:, 0] for name, rows in columns.costs.items()},
        {name: _filled(rows, count, 1)[:, 0] for name, rows in columns.conflicts.items()},
        np.array(columns.projected),
        np.array(columns.cut),
    )


def _filled(rows: "dict[int, tuple[float, ...]] | dict[int, float]", count: int, width: int) -> Floats:
    table = np.full((count, width), math.nan)
    if rows:
        table[list(rows)] = np.array(list(rows.values()), np.float64).reshape(len(rows), width)
    return _drawn(table)


def _drawn(table: Floats) -> Floats:
    return np.where(np.abs(table) <= GREATEST, table, math.nan)
