"""edge-run: drives one robot of a team by a guided flow policy."""

import contextlib
import importlib
import math
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Final

from edge_runtime.common.command_line import begun, check_output, command, write_report
from edge_runtime.common.realtime import EarlyWake, enter_realtime, freeze_garbage
from edge_runtime.common.signals import StopSignals
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.errors import EdgeError, FailedError
from edge_runtime.recording.recorder import Recorder, open_record
from edge_runtime.run.console import LiveLine, summary, use_colour
from edge_runtime.run.final_output import say
from edge_runtime.run.flags import chosen_bridge, make_mission, make_parser
from edge_runtime.run.run_report import RunReport, make_report
from edge_runtime.team.membership import Alone, TeamLink, open_fleet
from edge_runtime.telemetry.status_sender import Watch, open_watch

if TYPE_CHECKING:
    from edge_runtime.control.bridge import Bridge

BRIDGES: Final = {
    "sim": "firmware_bridge.simulation.bridge",
    "can": "firmware_bridge.can.bridge",
    "mavlink": "firmware_bridge.mavlink.bridge",
}
"""Modules that offer ``add_arguments``, ``options_from`` and ``open_bridge``; imported when chosen."""
STAGES: Final = ("read", "observe", "act", "limit", "write")
ACTION_SHARE: Final = 0.8
"""Share of the period by whose end the action must be sampled; the rest is for the command's way out."""
HOLD_S: Final = 1.0
"""The run ends when all robots have been at their goals for this long."""


@dataclass(frozen=True)
class Session:
    """What the loop works with."""

    controller: Controller
    grid: DeadlineGrid
    timing: TimingRecord
    monitor: Monitor
    watch: Watch
    recorder: Recorder | None
    dry_run: bool


def drive(session: Session, bridge: "Bridge", fleet: TeamLink, ending: Callable[[], str]) -> str:
    """Run the control loop until ``ending`` gives a reason, and return it."""
    controller, grid, timing, monitor = session.controller, session.grid, session.timing, session.monitor
    while not (reason := ending()):
        deadline_s = grid.wait()
        timing.begin(deadline_s)
        own = fleet.locate(bridge.read())
        if own is None:
            monitor.no_state()
            continue
        team = fleet.team(own)
        if guide := fleet.new_guide():
            controller.guide = guide
            session.watch.adopt(guide)
            monitor.judge_anew(own.stamp_s)
        timing.lap()
        observation = controller.observe(team)
        timing.lap()
        guided = controller.act(observation, team, deadline_s + ACTION_SHARE * grid.period_s)
        timing.lap()
        command = controller.limit(guided, team, time.monotonic())
        timing.lap()
        if not session.dry_run:
            bridge.write(fleet.for_base(command))
        timing.lap()
        timing.end()
        fleet.share(own, command)
        monitor.follow(team, guided, command)
        session.watch.follow(team, guided, command)
        if session.recorder:
            session.recorder.follow(deadline_s, team, observation, guided, command)
    return reason


def run(
    mission: Mission,
    bridge: "Bridge",
    fleet: TeamLink,
    signals: StopSignals,
    duration_s: float,
    *,
    dry_run: bool,
    early_wake_s: float = 0.0,
    stay: bool = False,
    recorder: Recorder | None = None,
) -> RunReport:
    """Drive the robot until goals are held, time is up, a signal or an operator ends it, or the link fails.

    With ``stay``, goals that are held do not end the run.
    """
    session = _prepare(mission, bridge, early_wake_s, recorder, dry_run=dry_run)
    monitor, grid = session.monitor, session.grid

    def over() -> str:
        duration = "duration" if grid.next_s >= duration_s else ""
        reason = signals.reason or fleet.stop_reason
        return reason or ("goals held" if monitor.all_hold and not stay else duration)

    freeze_garbage()
    failure = ""
    try:
        with contextlib.closing(session.watch), LiveLine(sys.stdout, mission.robot_id, monitor, grid):
            reason = drive(session, bridge, fleet, over)
            bridge.stop(reason)
    except EdgeError as error:
        reason = failure = str(error)
    return make_report(
        replace(mission, objective_set=session.controller.guide.asked),
        monitor,
        grid,
        session.timing,
        reason,
        bridge=bridge.name,
        backend=session.controller.policy.backend,
        dry_run=dry_run,
        failed=bool(failure),
        fleet=fleet.report(),
        log=recorder.end(reason, failed=bool(failure)) if recorder else None,
    )


def _prepare(
    mission: Mission, bridge: "Bridge", early_wake_s: float, recorder: Recorder | None, *, dry_run: bool
) -> Session:
    controller = mission.controllers(bridge.max_speed_m_s)[mission.robot_id]
    hold_ticks = max(1, math.ceil(HOLD_S * mission.rate_hz))
    sleep = EarlyWake(controller.rehearse, early_wake_s) if early_wake_s > 0.0 else time.sleep
    grid = DeadlineGrid(mission.period_s, sleep=sleep)
    monitor = Monitor(mission.fleet, hold_ticks, controller.policy.euler_steps)
    timing = TimingRecord(STAGES)
    if recorder:
        recorder.begin(mission, controller, grid, timing, bridge=bridge.name, dry_run=dry_run)
    watch = open_watch(mission, monitor, grid, timing)
    return Session(controller, grid, timing, monitor, watch, recorder, dry_run)


@command("edge-run")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-run``; returns the exit code."""
    with contextlib.ExitStack() as opening:
        drive_robot, flags = _open(arguments, opening)
        links = opening.pop_all()
    with begun():
        with links:
            report = drive_robot()
        # The robot stands and its links are closed: a terminal that takes no text holds up nobody.
        try:
            if flags.json:
                write_report("--json", flags.json, report)
        finally:
            say(summary(report, colour=use_colour(sys.stdout)), sys.stdout)
        if flags.animate and report.log:
            _animation().animate_run(report.log, flags.animate)
    if report.failed:
        raise FailedError(report.stop_reason)
    return 0


def _open(
    arguments: Sequence[str] | None, opening: contextlib.ExitStack
) -> tuple[Callable[[], RunReport], Namespace]:
    """Check all that the command line names and open the links; returns what drives, and the flags."""
    signals = opening.enter_context(StopSignals())
    link = importlib.import_module(BRIDGES[chosen_bridge(arguments, tuple(BRIDGES))])
    parser = make_parser(tuple(BRIDGES))
    link.add_arguments(parser)
    flags = parser.parse_args(arguments)
    mission = make_mission(flags)
    mission.bundle.field(mission.backend)  # what cannot compute is refused before a link opens
    if flags.json:
        check_output("--json", flags.json, (flags.objectives, flags.fleet))
    if flags.animate:
        _animation().check_animation(flags.animate, recorded=flags.log)
    recorder = opening.enter_context(open_record(flags))
    if flags.realtime:
        enter_realtime()  # before the bridge: its guard process inherits it
    bridge = link.open_bridge(mission, link.options_from(flags))
    local = bridge if flags.bridge == "sim" else Alone()
    # Entered last, left first: the robot is stopped before it leaves its team.
    fleet = opening.enter_context(open_fleet(mission, local))
    opening.enter_context(bridge)
    drive_robot = partial(
        run,
        mission,
        bridge,
        fleet,
        signals,
        flags.duration,
        dry_run=flags.dry_run,
        early_wake_s=1e-3 * flags.early_wake,
        stay=flags.stay,
        recorder=recorder,
    )
    return drive_robot, flags


def _animation() -> ModuleType:
    """Load what draws only where it is wanted: it needs an extra."""
    return importlib.import_module("edge_runtime.tools.report.animate")


if __name__ == "__main__":
    sys.exit(main())
