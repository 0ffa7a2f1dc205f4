"""The page that several robots' logs of one run make."""

import datetime
import math
from collections.abc import Iterable

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.tools.report import timeline
from edge_runtime.tools.report.digest import STAGES, RunDigest
from edge_runtime.tools.report.page import chart
from edge_runtime.tools.report.page.arena import Track, arena
from edge_runtime.tools.report.page.chart import Limit
from edge_runtime.tools.report.page.document import Facts, Figure, Item, Note, Page, Section, Table, Verdict
from edge_runtime.tools.report.team import Stretch, TeamDigest, fences, limits, separation, stretches

Series = dict[str, tuple[Floats, Floats]]


def make_page(team: TeamDigest, notes: tuple[str, ...] = ()) -> Page:
    """Compose the page; ``notes`` say what was wrong with a log."""
    start = team.runs[0].start
    when = datetime.datetime.fromtimestamp(team.zero_s, datetime.timezone.utc)
    robots = ", ".join(str(run.start.robot_id) for run in team.runs)
    logs = f"log of robot {robots}" if len(team.runs) == 1 else f"logs of robots {robots}"
    subtitle = (
        f"{when:%Y-%m-%d %H:%M:%S} UTC, {team.duration_s:.1f} s, policy {start.bundle.name}, "
        f"{start.settings.bridge} bridge, {start.settings.rate_hz:g} Hz, {logs}"
    )
    sections = (
        Section(
            "Where they went", [*(Note(text, warning=True) for text in notes), _map(team), *_heights(team)]
        ),
        Section("Against the limits", _against_limits(team)),
        Section("Objectives", _objectives(team)),
        Section("Faults and events", timeline.items(team)),
        Section("Timing", _timing(team)),
        Section("Messages", _messages(team)),
        Section("Machine and versions", [_machine(run) for run in team.runs]),
    )
    title = f"Run of {len(team.tracks)} robots" if len(team.tracks) != 1 else "Run of one robot"
    return Page(title, subtitle, _verdicts(team), [section for section in sections if section.items])


def _verdicts(team: TeamDigest) -> list[Verdict]:
    tolerance = team.runs[0].start.fleet.goal_tolerance_m
    last = [float(track.goal_distance_m[-1]) for track in team.with_goals if len(track.time_s)]
    there = sum(distance <= tolerance for distance in last)
    apart = [(track.time_s, separation(track, team)) for track in team.tracks]
    speed = [(track.time_s, track.speed_m_s) for track in team.tracks]
    margins = stretches(team, "safety_margin", "distance_m")
    speeds = stretches(team, "speed_limit", "limit_m_s")
    misses = sum(int(run.misses[-1]) for run in team.runs if len(run.misses))
    stopped = sum(sum(map(bool, run.stopped)) for run in team.runs)
    ticks = sum(len(run.time_s) for run in team.runs)
    arrived = Verdict(
        "At their goals", f"{there} of {len(last)}", f"within {tolerance:g} m", there == len(last)
    )
    return [
        *([arrived] if last else []),
        _against("Least separation", apart, margins, "safety margin {:g} m", 1),
        _against("Greatest speed", speed, speeds, "speed limit {:g} m/s", -1),
        Verdict("Deadlines missed", str(misses), f"of {ticks + misses}", misses == 0),
        Verdict("Stopped ticks", str(stopped), f"of {ticks}", stopped == 0),
    ]


def _least(values: Iterable[Floats]) -> float:
    finite = [float(np.nanmin(row)) for row in values if np.isfinite(row).any()]
    return min(finite, default=math.nan)


def _against(
    name: str, rows: list[tuple[Floats, Floats]], asked: list[Stretch], form: str, sign: int
) -> Verdict:
    """The extreme of the whole run, and each limit over its own time; ``sign`` is -1 for upper limits."""
    unit = form.rpartition(" ")[2]
    whole = sign * _least(sign * values for _, values in rows)
    if math.isnan(whole):
        return Verdict(name, "-", "nobody was seen")
    shown = f"{whole:.3f} {unit}"
    if not asked:
        return Verdict(name, shown, "no limit was asked for")
    worst: dict[float, float] = {}
    for limit, _, judged_s, end_s in asked:
        then = [values[(time_s >= judged_s) & (time_s < end_s)] for time_s, values in rows]
        least = _least(sign * values for values in then)
        if not math.isnan(least):
            worst[limit] = min(least, worst.get(limit, math.inf))
    if not worst:
        return Verdict(name, shown, "no limit held long enough to be judged")
    kept = {limit: least >= sign * limit for limit, least in worst.items()}
    if len(worst) == 1 and sign * whole in worst.values():
        return Verdict(name, shown, form.format(*worst), all(kept.values()))
    told = (
        f"{sign * least:.3f} under {form.format(limit)}{'' if kept[limit] else ', violated'}"
        for limit, least in worst.items()
    )
    return Verdict(name, shown, "; ".join(told), all(kept.values()))


def _map(team: TeamDigest) -> Figure:
    start = team.runs[0].start
    tracks = [
        Track(track.name, track.position_m[:, :2], track.place.goal_m, start.bundle.radius_m)
        for track in team.tracks
    ]
    tracks += [Track(one.name, one.position_m, one.place.goal_m, one.place.radius_m) for one in team.objects]
    drawn = arena(tracks, fences(team), start.fleet.goal_tolerance_m)
    caption = (
        "Ways from the starts (dots) to the last positions (discs, to scale); crosses are goals, "
        "rings their tolerance."
    )
    return Figure(drawn, f"Seen from above. {caption}" if start.fleet.dims == 3 else caption)


def _heights(team: TeamDigest) -> list[Item]:
    if team.runs[0].start.fleet.dims == 2:
        return []
    heights: Series = {track.name: (track.time_s, track.position_m[:, 2]) for track in team.tracks}
    return [Figure(chart.over_time(heights, "height in m"), "Height, which the map does not show.")]


def _against_limits(team: TeamDigest) -> list[Item]:
    apart: Series = {track.name: (track.time_s, separation(track, team)) for track in team.tracks}
    apart = {name: rows for name, rows in apart.items() if np.isfinite(rows[1]).any()}
    speed: Series = {track.name: (track.time_s, track.speed_m_s) for track in team.tracks}
    goal: Series = {track.name: (track.time_s, track.goal_distance_m) for track in team.with_goals}
    tolerance = team.runs[0].start.fleet.goal_tolerance_m
    items: list[Item] = []
    if apart:
        margins = limits(team, "safety_margin", "distance_m", "m")
        items.append(
            Figure(
                chart.over_time(apart, "nearest centre in m", margins),
                "Distance from each robot's centre to the nearest other one; it should stay above the line.",
            )
        )
    speeds = limits(team, "speed_limit", "limit_m_s", "m/s")
    items.append(
        Figure(chart.over_time(speed, "speed in m/s", speeds), "Speed; it should stay below the line.")
    )
    near = [Limit(tolerance, f"tolerance {tolerance:g} m")]
    if goal:
        items.append(Figure(chart.over_time(goal, "distance in m", near), "Distance to the own goal."))
    return items


def _objectives(team: TeamDigest) -> list[Item]:
    names = dict.fromkeys(name for run in team.runs for name in run.costs)
    items: list[Item] = []
    kept = []
    for name in names:
        costs = _costs(team, name)
        if not any(np.nanmax(rows, initial=0.0) > 0.0 for _, rows in costs.values()):
            kept.append(_words(name))
            continue
        drawn = chart.over_time(costs, "cost, action units²")
        items.append(Figure(drawn, f"Cost of {_words(name)} at the newest terminal estimate."))
    conflicts = {_name(run): _shares(run.conflicts) for run in team.runs if run.conflicts}
    if any(any(shares.values()) for shares in conflicts.values()):
        drawn = chart.bars(conflicts, "steps in conflict in %")
        caption = "Conflicts: share of all steps in which an objective pulled against another one."
        items.append(Figure(drawn, caption))
    elif conflicts:
        kept.append("conflicts between objectives")
    if kept:
        items.append(Note(f"0 in every tick: {', '.join(kept)}."))
    return [*items, _objectives_in_force(team)]


def _shares(conflicts: dict[str, Floats]) -> dict[str, float]:
    return {
        _words(name): 100.0 * float(np.nanmean(rows))
        for name, rows in conflicts.items()
        if np.isfinite(rows).any()
    }


def _objectives_in_force(team: TeamDigest) -> Table:
    rows = [
        (
            _name(run),
            f"{since - team.zero_s:.1f}",
            str(chosen.version),
            f"{chosen.mode}, scale {chosen.scale:g}",
            ", ".join(item.name for item in chosen.objectives if item.active) or "none",
            f"{100 * float(np.mean(run.projected)) if len(run.projected) else 0.0:.1f}",
        )
        for run in team.runs
        for since, chosen in run.sets
    ]
    head = ("robot", "from s", "set", "guidance", "objectives", "steps projected in %")
    return Table(head, rows, "What steered, and how often a projection changed the guidance.")


def _timing(team: TeamDigest) -> list[Item]:
    stages = {
        stage: np.concatenate([run.stage_us[:, index] for run in team.runs]) / 1e3
        for index, stage in enumerate(STAGES)
    }
    misses: Series = {_name(run): (team.times(run), run.misses) for run in team.runs if len(run.time_s)}
    if not misses:
        return []
    table = [
        (stage, *(f"{value:.3f}" for value in (*np.percentile(values, [50, 99, 99.9]), values.max())))
        for stage, values in stages.items()
    ]
    caption = "How long each stage took, all robots together; wake is how late a tick began, tick the whole."
    items: list[Item] = [Figure(chart.histograms(stages, "duration in ms"), caption)]
    if any(rows[1].any() for rows in misses.values()):
        drawn = chart.over_time(misses, "deadlines missed", steps=True)
        items.append(Figure(drawn, "Deadlines missed since the start."))
    items.append(Table(("stage", "p50 ms", "p99 ms", "p99.9 ms", "max ms"), table))
    return items


def _messages(team: TeamDigest) -> list[Item]:
    worst: Series = {}
    for run in team.runs:
        if run.age_s and len(run.time_s):
            ages = np.column_stack(list(run.age_s.values()))
            seen = np.isfinite(ages).any(1)
            oldest = np.full(len(ages), np.nan)
            oldest[seen] = 1e3 * np.nanmax(ages[seen], 1)
            worst[_name(run)] = (team.times(run), oldest)
    if not any((rows[1] > 0.0).any() for rows in worst.values()):
        return []
    caption = "Age of the oldest teammate's state that each robot acted on, tick by tick."
    return [Figure(chart.over_time(worst, "age in ms"), caption)]


def _costs(team: TeamDigest, name: str) -> Series:
    return {_name(run): (team.times(run), run.costs[name]) for run in team.runs if name in run.costs}


def _name(run: RunDigest) -> str:
    return f"robot {run.start.robot_id}"


def _words(name: str) -> str:
    return name.replace("_", " ")


def _machine(run: RunDigest) -> Facts:
    start = run.start
    machine, versions, settings = start.machine, start.versions, start.settings
    return Facts(
        [
            ("robot", str(start.robot_id)),
            ("machine", f"{machine.host}, {machine.processor}, {machine.cores} cores, {machine.kernel}"),
            ("versions", f"cfpg-edge {versions.cfpg_edge}, Python {versions.python}, numpy {versions.numpy}"),
            ("policy", f"{start.bundle.name}, SHA-256 {start.bundle.sha256[:16]}"),
            ("fleet", f"{start.fleet.path}, SHA-256 {start.fleet.sha256[:16]}"),
            ("backend", f"{settings.backend} {settings.engine}".strip()),
            ("real-time", "yes" if settings.realtime else "no"),
            ("seed", str(settings.seed)),
            ("ended", run.end.stop_reason if run.end else "the log breaks off: the process was killed"),
            ("ticks lost to the log", str(run.end.lost) if run.end else "unknown"),
        ]
    )
