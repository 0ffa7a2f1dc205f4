"""Several robots' runs on one time axis."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeGuard

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.common.bounds import GREATEST
from edge_runtime.control.judgement import SETTLE_S
from edge_runtime.messages import Vector2
from edge_runtime.recording.schema import LoggedObjective, LoggedObjectiveSet, ObjectPlace, RobotPlace
from edge_runtime.tools.report.digest import RunDigest
from edge_runtime.tools.report.page.arena import Circle
from edge_runtime.tools.report.page.chart import Limit


@dataclass(frozen=True)
class RobotTrack:
    """Where one robot was: from its own log, or else as the first robot that has one saw it."""

    place: RobotPlace
    time_s: Floats
    """(T,), since the report's zero."""
    position_m: Floats
    """(T, dims)"""
    velocity_m_s: Floats
    """(T, dims)"""

    @property
    def name(self) -> str:
        """What charts call it."""
        return f"robot {self.place.robot_id}"

    @property
    def speed_m_s(self) -> Floats:
        """(T,) lengths of the velocity."""
        return _length(self.velocity_m_s)

    @property
    def goal_distance_m(self) -> Floats:
        """(T,) distances to its own goal; NaN without one."""
        return _length(self.position_m - np.array(self.place.goal_m or np.nan))


@dataclass(frozen=True)
class ObjectTrack:
    """Where a tracked object was, as the first robot that saw it knew."""

    place: ObjectPlace
    time_s: Floats
    """(T,), since the report's zero."""
    position_m: Floats
    """(T, 2)"""

    @property
    def name(self) -> str:
        """What charts call it."""
        return self.place.name

    @property
    def goal_distance_m(self) -> Floats:
        """(T,) distances to its goal in the plane; NaN without one."""
        goal_m = (self.place.goal_m or (np.nan, np.nan))[:2]
        return _length(self.position_m - np.array(goal_m))


@dataclass(frozen=True)
class TeamDigest:
    """The runs of one team; all times count from the first robot's start."""

    runs: tuple[RunDigest, ...]
    zero_s: float
    """The report's zero, since 1970."""
    tracks: tuple[RobotTrack, ...]
    objects: tuple[ObjectTrack, ...] = ()

    @property
    def with_goals(self) -> list[RobotTrack | ObjectTrack]:
        """Whatever is to be somewhere."""
        every: list[RobotTrack | ObjectTrack] = [*self.tracks, *self.objects]
        return [track for track in every if track.place.goal_m]

    @property
    def duration_s(self) -> float:
        """To the newest tick of any robot."""
        return max((float(run.time_s[-1]) - self.zero_s for run in self.runs if len(run.time_s)), default=0.0)

    def times(self, run: RunDigest) -> Floats:
        """(T,) times of a run's ticks since the report's zero."""
        return run.time_s - self.zero_s


def team_of(runs: Sequence[RunDigest]) -> TeamDigest:
    """Lay runs, one at least, on one axis; the first one's fleet file says who is in the team."""
    zero_s = min(run.start.started_unix_s for run in runs)
    by_own = {run.start.robot_id: run for run in runs}
    tracks = []
    for place in runs[0].start.fleet.robots:
        source = by_own.get(place.robot_id) or next(
            (run for run in runs if place.robot_id in run.motion), None
        )
        if source is None or place.robot_id not in source.motion:
            continue
        motion = source.motion[place.robot_id]
        dims = motion.shape[1] // 2
        tracks.append(RobotTrack(place, source.time_s - zero_s, motion[:, :dims], motion[:, dims:]))
    return TeamDigest(tuple(runs), zero_s, tuple(tracks), tuple(_objects(runs, zero_s)))


def _objects(runs: Sequence[RunDigest], zero_s: float) -> Iterator[ObjectTrack]:
    for place in runs[0].start.fleet.tracked:
        if source := next((run for run in runs if place.name in run.objects), None):
            yield ObjectTrack(place, source.time_s - zero_s, source.objects[place.name])


def _length(vectors: Floats) -> Floats:
    length: Floats = np.linalg.norm(vectors, axis=-1)
    return length


def separation(one: RobotTrack, team: TeamDigest) -> Floats:
    """(T,) distance from one robot to the nearest other centre, at its own ticks; NaN without any."""
    nearest = np.full(len(one.time_s), np.inf)
    for other in team.tracks:
        if other is one or not len(other.time_s):
            continue
        there = np.column_stack([np.interp(one.time_s, other.time_s, axis) for axis in other.position_m.T])
        together = (one.time_s >= other.time_s[0] - 0.1) & (one.time_s <= other.time_s[-1] + 0.1)
        distance = _length(one.position_m - there)
        nearest = np.fmin(nearest, np.where(together, distance, np.inf))
    return np.where(np.isfinite(nearest), nearest, np.nan)


class Stretch(NamedTuple):
    """When a limit was to be kept, since the report's zero."""

    limit: float
    begin_s: float
    """When it was taken up."""
    judged_s: float
    """From when on it counts."""
    end_s: float


def limits(team: TeamDigest, kind: str, field: str, unit: str) -> list[Limit]:
    """What objectives of a kind asked for in any of the runs' sets, guided or not, while they did."""
    lines, named = [], set[float]()
    for limit, begin_s, _, end_s in stretches(team, kind, field):
        name = "" if limit in named else f"{kind.replace('_', ' ')} {limit:g} {unit}"
        lines.append(Limit(limit, name, begin_s, end_s))
        named.add(limit)
    return lines


def stretches(team: TeamDigest, kind: str, field: str) -> list[Stretch]:
    """When each limit of a kind held; those taken up while driving count from `SETTLE_S` later on."""
    found = set()
    for run in team.runs:
        begin_s = judged_s = -math.inf
        for place, (_, chosen) in enumerate(run.sets, 1):
            end_s = run.sets[place][0] - team.zero_s if place < len(run.sets) else math.inf
            found |= {Stretch(limit, begin_s, judged_s, end_s) for limit in _asked(chosen, kind, field)}
            begin_s, judged_s = end_s, end_s + SETTLE_S
    return sorted(found, key=lambda one: (one.begin_s, one.limit))


def fences(team: TeamDigest) -> list[Circle]:
    """Circles that any objective names by ``centre_m`` and ``radius_m``."""
    found: dict[tuple[Vector2, float], Circle] = {}
    for run in team.runs:
        for _, chosen in run.sets:
            for item in chosen.objectives:
                if fence := _fence(item):
                    found[fence.centre_m, fence.radius_m] = fence
    return list(found.values())


def _asked(chosen: LoggedObjectiveSet, kind: str, field: str) -> list[float]:
    """The limits that a set's objectives of a kind name."""
    values = [item.fields().get(field) for item in chosen.objectives if item.kind == kind]
    return [value for value in values if _is_length(value)]


def _fence(item: LoggedObjective) -> Circle | None:
    asked = item.fields()
    centre, radius_m = asked.get("centre_m"), asked.get("radius_m")
    if not (isinstance(centre, list) and len(centre) == 2):
        return None
    x, y = centre
    return (
        Circle((x, y), radius_m, item.name)
        if _is_length(x) and _is_length(y) and _is_length(radius_m)
        else None
    )


def _is_length(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and abs(value) <= GREATEST
