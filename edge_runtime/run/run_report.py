"""What a run ends with: the record that ``--json`` writes and the summary shows."""

import math

import msgspec

from edge_runtime.control.judgement import Judgement
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid, Percentiles, TimingRecord
from edge_runtime.control.stopping import Stopping
from edge_runtime.observation.familiarity import knows_training
from edge_runtime.recording.wire import LogReport
from edge_runtime.team.report import FleetReport


class RobotReport(msgspec.Struct, frozen=True):
    """One robot of the team, as the reporting robot saw it; None for what it never saw."""

    robot_id: int
    goal_distance_m: float | None
    """None as well where it has no goal."""
    goal_reached: bool
    min_separation_m: float | None
    """Least distance between its centre and any other's."""
    max_speed_m_s: float
    has_goal: bool = True
    """Whether the fleet file gives it one."""
    silent_s: float = 0.0
    """How long it was masked: what it did then is in none of these figures."""


class RunReport(msgspec.Struct, frozen=True, kw_only=True):
    """A finished run."""

    robot_id: int
    policy: str
    backend: str
    bridge: str
    dry_run: bool
    failed: bool
    """The link to the robot failed; ``stop_reason`` says how."""
    objectives: tuple[str, ...]
    """Names of the objectives that steered; none if unguided."""
    guidance_mode: str
    ticks: int
    rate_hz: float
    """Ticks per second, from the first tick to the last."""
    nominal_rate_hz: float
    deadline_misses: int
    longest_miss_burst: int
    anytime_ticks: int
    """Ticks whose sample was cut short by the deadline."""
    faults: dict[str, int]
    """Ticks that stopped the robot, by reason."""
    unfamiliar: dict[str, int] | None = None
    """Ticks whose observation was outside of what training had, by the worst field; None if the bundle does
    not say what training had."""
    complaints: tuple[str, ...] = ()
    """What the robot's firmware complained of and drove on with."""
    objective_fault: str = ""
    """The first of them that was an objective's; such a run has failed."""
    tick_us: Percentiles
    """From wake-up to the command's departure."""
    stage_us: dict[str, Percentiles]
    goal_reached: bool
    """This robot is at its goal."""
    team_goals_reached: bool
    min_separation_m: float | None
    """Least distance between any two centres of the team in the whole run; None if nobody else was seen."""
    safety_margin_m: float | None
    """What the last objectives ask of it, guided or not."""
    max_speed_m_s: float
    """Greatest speed of any robot of the team in the whole run."""
    speed_limit_m_s: float | None
    """What the last objectives ask of it."""
    settled: bool = True
    """False if the last objectives held too short a time to be judged."""
    judgements: tuple[Judgement, ...]
    """One for each set of objectives, in the order in which they held."""
    robots: tuple[RobotReport, ...]
    goals: int = 0
    """How many robots and tracked objects have a goal."""
    goals_reached: int = 0
    objects: dict[str, float | None] = {}
    """How far each tracked object that has a goal is from it, in m; None for what was never seen."""
    fleet: FleetReport | None
    """The team's network; None for a team in one process."""
    log: LogReport | None = None
    """What became of the run's record; None if it was not to be recorded."""
    stopping: Stopping | None = None
    """How far this robot travels after each fault; None where nothing real moves."""
    stop_reason: str


def make_report(
    mission: Mission,
    monitor: Monitor,
    grid: DeadlineGrid,
    timing: TimingRecord,
    stop_reason: str,
    *,
    bridge: str,
    complaints: tuple[str, ...] = (),
    backend: str,
    dry_run: bool,
    failed: bool,
    fleet: FleetReport | None,
    log: LogReport | None = None,
    stopping: Stopping | None = None,
) -> RunReport:
    """Sum up a run."""
    robots = tuple(_robot_report(robot_id, monitor, mission.period_s) for robot_id in monitor.robots)
    judgements = tuple(judging.judgement(mission.period_s) for judging in monitor.judged)
    separations = [robot.min_separation_m for robot in robots if robot.min_separation_m is not None]
    return RunReport(
        robot_id=mission.robot_id,
        policy=mission.bundle.manifest.name,
        backend=backend,
        bridge=bridge,
        dry_run=dry_run,
        failed=failed,
        objectives=tuple(objective.name for objective in mission.objectives),
        guidance_mode=mission.objective_set.guidance.mode,
        ticks=grid.ticks,
        rate_hz=grid.rate_hz,
        nominal_rate_hz=mission.rate_hz,
        deadline_misses=grid.misses,
        longest_miss_burst=grid.longest_burst,
        anytime_ticks=monitor.anytime_ticks,
        faults=dict(monitor.faults),
        unfamiliar=dict(monitor.unfamiliar) if knows_training(mission.bundle.manifest.observation) else None,
        complaints=complaints,
        objective_fault=monitor.objective_fault,
        tick_us=timing.tick_us(),
        stage_us=timing.stage_us(),
        goal_reached=monitor.reached(mission.robot_id),
        team_goals_reached=0 < monitor.goals == monitor.goals_reached,
        min_separation_m=min(separations, default=None),
        max_speed_m_s=max(robot.max_speed_m_s for robot in robots),
        safety_margin_m=judgements[-1].safety_margin_m,
        speed_limit_m_s=judgements[-1].speed_limit_m_s,
        settled=judgements[-1].judged_s > 0.0,
        judgements=judgements,
        robots=robots,
        goals=monitor.goals,
        goals_reached=monitor.goals_reached,
        objects={name: away if math.isfinite(away) else None for name, away in monitor.objects.items()},
        fleet=fleet,
        log=log,
        stopping=stopping,
        stop_reason=stop_reason,
    )


def _robot_report(robot_id: int, monitor: Monitor, period_s: float) -> RobotReport:
    tally = monitor.robots[robot_id]
    return RobotReport(
        robot_id,
        tally.goal_distance_m if math.isfinite(tally.goal_distance_m) else None,
        monitor.reached(robot_id),
        tally.min_separation_m if math.isfinite(tally.min_separation_m) else None,
        tally.max_speed_m_s,
        monitor.has_goal(robot_id),
        tally.silent_ticks * period_s,
    )
