"""The rows of the table: a run of edge-sil each, and what must be seen in its report."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import edge_runtime
from edge_runtime.control.rate import Percentiles
from edge_runtime.control.start import PATIENCE
from firmware_bridge.sil.report.records import RobotQuality, SilReport

FLEETS = Path(edge_runtime.__file__).parent / "fleets"
POSE_MS = 3.0
"""With real-time scheduling, p99 of the time within which a pose is a command at the firmware."""
POSE_SHORT_MS = 6.0
"""The same of a short run, whose p99 is about its second worst tick."""
SHORT_TICKS = 500
Judge = Callable[[SilReport], Iterator[str]]
"""Yields what was not seen; nothing if all was."""


class Late(str):
    """What was not seen, if a machine that others share can bring it about alone, by computing late."""

    __slots__ = ()


class Case(NamedTuple):
    """One row."""

    name: str
    asked: str
    judge: Judge
    show: Callable[[SilReport], str]
    """What was seen, in a few words."""
    bridge: str = "can"
    robots: int = 4
    rate_hz: float = 50.0
    long_s: float = 20.0
    short_s: float = 4.0
    faults: str = ""
    """A timeline; {half}, {whole}, {duration} and {frames} are put in."""
    realtime: bool = True
    fleet: Path | None = None
    """The team's file; None: a team that edge-sil makes."""
    pose_hz: float = 0.0
    """Of a pose stream; 0: the firmware tells poses."""
    own_clock: bool = False
    """Its processes have a wall clock of their own; see `benchmarks.sil.clock`."""


def cases() -> tuple[Case, ...]:
    """Return the table's rows in its order."""
    rate = "99.5 % of the ticks, no burst over 2"
    return (
        Case("rate, CAN", rate, _rate, _show_rate, long_s=60.0),
        Case("rate, MAVLink", rate, _rate, _show_rate, bridge="mavlink", long_s=60.0),
        Case(
            "rate, CAN, ordinary scheduling",
            "every miss counted",
            _counted,
            _show_counted,
            long_s=60.0,
            realtime=False,
        ),
        Case(
            "rate, MAVLink, ordinary scheduling",
            "every miss counted",
            _counted,
            _show_counted,
            bridge="mavlink",
            long_s=60.0,
            realtime=False,
        ),
        *pose_cases(),
        Case(
            "20 % packet loss",
            "message age p99 within 2 periods, no collision",
            _loss,
            _show_loss,
            faults='kind = "loss"\nat_s = 0.0\nfor_s = {duration}\nshare = 0.2',
        ),
        Case(
            "20 % packet loss, Zenoh",
            "message age p99 within 2 periods, no collision",
            _loss,
            _show_loss,
            faults='kind = "loss"\nat_s = 0.0\nfor_s = {duration}\nshare = 0.2',
            fleet=FLEETS / "zenoh.toml",
        ),
        Case(
            "3 s blackout",
            "the team stops, then goes on; no stale state used",
            _blackout,
            _show_blackout,
            short_s=7.0,
            faults='kind = "blackout"\nat_s = 1.0\nfor_s = 3.0',
        ),
        Case(
            "neighbour killed",
            "masked within 3 periods, no collision, the others arrive",
            _killed,
            _show_killed,
            short_s=11.0,
            faults='kind = "kill"\nat_s = 1.0\nrobot = 3',
            fleet=Path(__file__).with_name("lane.toml"),
        ),
        Case(
            "hostile frames",
            "none accepted, rate unchanged",
            _hostile,
            _show_hostile,
            long_s=60.0,
            faults='kind = "hostile"\nat_s = 0.0\nfor_s = {whole}\nframes = {frames}',
        ),
        Case(
            "log disk full",
            "loop unaffected, at most 1 s of log lost",
            _log_lost,
            _show_log,
            faults='kind = "log_full"\nat_s = {half}\nfor_s = {half}',
        ),
        Case(
            "logger killed",
            "loop unaffected, at most 1 s of log lost",
            _log_lost,
            _show_log,
            faults='kind = "kill"\npart = "logger"\nrobot = 0\nat_s = {half}',
        ),
        Case(
            "objective swap under way",
            "all change at the same tick",
            _swapped,
            _show_swapped,
            faults='kind = "objectives"\nfile = "slow.toml"\nat_s = 1.0',
        ),
        Case(
            "clock jump of an hour",
            "no missed tick",
            _jumped,
            _show_jumped,
            faults='kind = "clock_jump"\nat_s = {half}\nwhole_machine = true',
            own_clock=True,
        ),
    )


def pose_cases() -> tuple[Case, ...]:
    """Return the rows that tell how soon a pose becomes a command."""
    limits = f"p99 within {POSE_MS:g} ms, or {POSE_SHORT_MS:g} of fewer than {SHORT_TICKS} ticks"
    asked, how = f"{limits}; without --realtime, half a period", (_pose_age, _show_pose_age)
    return (
        Case("pose to command, CAN", asked, *how),
        Case("pose to command, MAVLink", asked, *how, bridge="mavlink"),
        Case("pose to command, CAN, poses at 120 Hz", asked, *how, pose_hz=120.0),
    )


def soak() -> Case:
    """Return the longest row, for a night or a coffee."""
    return Case(
        "soak, 8 robots",
        "no crash, growth under 1 MiB a process",
        _soaked,
        _show_soaked,
        robots=8,
        rate_hz=20.0,
        long_s=600.0,
        short_s=10.0,
    )


def _driving(report: SilReport) -> list[RobotQuality]:
    return [robot for robot in report.robots if not robot.exempt]


def _rate(report: SilReport) -> Iterator[str]:
    for robot in _driving(report):
        if robot.achieved_rate_share < 0.995 or robot.longest_burst > 2:
            yield Late(
                f"robot {robot.robot_id}: {robot.achieved_rate_share:.2%}, burst {robot.longest_burst}"
            )


def _show_rate(report: SilReport) -> str:
    team = report.team
    jitter = team.period_jitter_ms
    text = f"{team.achieved_rate_share:.2%}, burst {team.longest_burst}"
    return text if jitter is None else f"{text}, jitter p99 {jitter.p99:.2f} ms"


def _counted(report: SilReport) -> Iterator[str]:
    for robot in _driving(report):
        lacking, counted = robot.lacking_commands, robot.counted_misses
        if lacking is None or lacking != counted:
            yield f"robot {robot.robot_id}: {lacking} commands lacking, {counted} counted by its loop"


def _show_counted(report: SilReport) -> str:
    robots = _driving(report)
    lacking = sum(robot.lacking_commands or 0 for robot in robots)
    counted = sum(robot.counted_misses or 0 for robot in robots)
    stopped = sum(
        "stopped" in robot.stop_reason for robot in robots
    )  # by its guard: no tick was due any more
    text = f"{_show_rate(report)}; {lacking} commands lacking, {counted} counted by the loops"
    return text + (f"; {stopped} robots stopped by their guards" if stopped else "")


def _pose_age(report: SilReport) -> Iterator[str]:
    most_ms = POSE_MS if report.duration_s * report.rate_hz >= SHORT_TICKS else POSE_SHORT_MS
    if not report.machine.realtime:
        most_ms = PATIENCE * 1e3 / report.rate_hz
    for robot in _driving(report):
        yield from _aged(robot, robot.pose_to_command_age_ms, most_ms)


def _aged(robot: RobotQuality, age_ms: Percentiles | None, most_ms: float) -> Iterator[str]:
    if age_ms is None:
        yield f"robot {robot.robot_id}: no age"
    elif age_ms.p99 > most_ms:
        yield Late(f"robot {robot.robot_id}: {age_ms.p99:.1f} ms")


def _show_pose_age(report: SilReport) -> str:
    age = report.team.pose_to_command_age_ms
    return "-" if age is None else f"p50 {age.p50:.1f}, p99 {age.p99:.1f}, max {age.max:.1f} ms"


def _no_collision(report: SilReport) -> Iterator[str]:
    if report.team.collisions:
        yield f"{report.team.collisions} collisions"


def _loss(report: SilReport) -> Iterator[str]:
    yield from _no_collision(report)
    for robot in _driving(report):
        yield from _aged(robot, robot.fleet_message_age_ms, 2e3 / report.rate_hz)


def _show_loss(report: SilReport) -> str:
    message, used = report.team.fleet_message_age_ms, report.team.fleet_used_age_ms
    if message is None or used is None:
        return "-"
    return (
        f"messages p99 {message.p99:.1f} ms, states used p99 {used.p99:.1f} ms, "
        f"{report.team.collisions} collisions"
    )


def _blackout(report: SilReport) -> Iterator[str]:
    yield from _no_collision(report)
    for robot in _driving(report):
        if not any(begin < 3.5 < end < 4.5 for begin, end in robot.halts_s):
            yield f"robot {robot.robot_id} did not stop and go on: {robot.halts_s}"
    yield from _stale(report)


def _stale(report: SilReport) -> Iterator[str]:
    for robot in _driving(report):
        age = robot.fleet_used_age_ms
        if age is None or age.max > 3e3 / report.rate_hz + 1e-6:
            yield f"robot {robot.robot_id} used a state {'-' if age is None else f'{age.max:.1f}'} ms old"


def _show_blackout(report: SilReport) -> str:
    halts = [halt for robot in _driving(report) for halt in robot.halts_s if halt[0] < 3.5 < halt[1]]
    if not halts:
        return "-"
    begin, end = min(halt[0] for halt in halts) - 1.0, max(halt[1] for halt in halts) - 4.0
    return f"stopped {begin:.2f} s into it, drove {end:.2f} s after it; {_oldest_used(report)}"


def _oldest_used(report: SilReport) -> str:
    oldest = max((r.fleet_used_age_ms.max for r in _driving(report) if r.fleet_used_age_ms), default=0.0)
    return f"oldest state used {oldest:.1f} ms"


def _killed(report: SilReport) -> Iterator[str]:
    yield from _no_collision(report)
    yield from _stale(report)
    for robot in _driving(report):
        if not robot.goals_reached:
            away_m = math.inf if robot.goal_distance_m is None else robot.goal_distance_m
            yield f"robot {robot.robot_id} did not arrive: {away_m:.2f} m away"


def _show_killed(report: SilReport) -> str:
    arrived = [robot.goals_reached for robot in _driving(report)]
    collisions = f"{report.team.collisions} collisions"
    return f"{_oldest_used(report)}, {collisions}, {sum(arrived)} of {len(arrived)} arrived"


def _hostile(report: SilReport) -> Iterator[str]:
    yield from _rate(report)
    for robot in _driving(report):
        heard = sum(other.sent_messages for other in report.robots if other is not robot)
        if robot.accepted_messages > heard:
            yield f"robot {robot.robot_id} accepted {robot.accepted_messages} messages"
        if not robot.refused_messages.get("foreign"):
            yield f"robot {robot.robot_id} refused no foreign frame"


def _show_hostile(report: SilReport) -> str:
    causes = ("foreign", "malformed")
    refused = sum(robot.refused_messages.get(cause, 0) for robot in report.robots for cause in causes)
    return f"{refused:,} refused, {_show_rate(report)}"


def _log_lost(report: SilReport) -> Iterator[str]:
    yield from _rate(report)
    [fault] = report.faults
    struck = [robot for robot in report.robots if fault.kind == "log_full" or robot.robot_id == 0]
    for robot in struck:
        if not robot.log_gaps_s:
            yield f"robot {robot.robot_id}: its log did not end"
        elif robot.log_gaps_s[0][0] < fault.at_s - 1.0:
            yield f"robot {robot.robot_id}: its log lacks {robot.log_gaps_s}"


def _show_log(report: SilReport) -> str:
    [fault] = report.faults
    lost = max((fault.at_s - r.log_gaps_s[0][0] for r in report.robots if r.log_gaps_s), default=0.0)
    return f"{_show_rate(report)}; {max(lost, 0.0):.2f} s of log lost before the fault"


def _swapped(report: SilReport) -> Iterator[str]:
    changes = [robot.objective_changes_s for robot in report.robots]
    if any(len(change) != 1 for change in changes):
        yield f"changes: {changes}"
        return
    moments = [change[0][0] for change in changes]
    # Deadlines of one number are within a period on all robots, and a tick may wait for its pose.
    if max(moments) - min(moments) >= (1.0 + PATIENCE) / report.rate_hz + 2e-3:
        yield f"changed {max(moments) - min(moments):.3f} s apart"


def _show_swapped(report: SilReport) -> str:
    moments = [change[0] for robot in report.robots for change in robot.objective_changes_s]
    apart = f", {1e3 * (max(moments) - min(moments)):.1f} ms apart" if moments else ""
    return f"{len(moments)} of {len(report.robots)} robots changed{apart}"


def _jumped(report: SilReport) -> Iterator[str]:
    for robot in _driving(report):
        if robot.deadline_misses:
            yield Late(f"robot {robot.robot_id} missed {robot.deadline_misses} ticks")
        if robot.lacking_commands is None or robot.lacking_commands != robot.counted_misses:
            yield f"robot {robot.robot_id} did not count its misses"


def _show_jumped(report: SilReport) -> str:
    age = report.team.fleet_used_age_ms
    oldest = "" if age is None else f", oldest state used {age.max:.1f} ms"
    return f"{report.team.deadline_misses} ticks missed{oldest}"


def _soaked(report: SilReport) -> Iterator[str]:
    yield from _no_collision(report)
    for process in report.processes:
        if process.memory_growth_mib >= 1.0:
            yield f"{process.name} grew by {process.memory_growth_mib:.2f} MiB"


def _show_soaked(report: SilReport) -> str:
    most = max(process.memory_growth_mib for process in report.processes)
    return f"{len(report.ended)} crashes, growth {most:.2f} MiB at most, {_show_rate(report)}"
