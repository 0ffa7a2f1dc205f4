"""One robot's control loop: a tick is read, observe, act, limit, write, in the order of the data."""

import contextlib
import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from edge_runtime.common.command_line import complain
from edge_runtime.common.realtime import freeze_garbage
from edge_runtime.common.signals import Overdue, StopSignals
from edge_runtime.control.bridge import Bridge
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.control.start import PoseSource, StateGrid
from edge_runtime.control.stopping import stopping
from edge_runtime.control.trust import note_run
from edge_runtime.errors import BridgeError, EdgeError
from edge_runtime.guidance.slope_check import SlopeCheck
from edge_runtime.recording.recorder import Recorder
from edge_runtime.run.console import LiveLine
from edge_runtime.run.run_report import RunReport, make_report
from edge_runtime.team.handover import Takeover
from edge_runtime.team.membership import TeamLink
from edge_runtime.telemetry.status_sender import Watch, open_watch

STAGES: Final = ("read", "observe", "act", "limit", "write")
ACTION_SHARE: Final = 0.8
"""Share of the period by whose end the action must be sampled; the rest is for the command's way out."""
DURATION: Final = "duration"
"""Why a run ends whose time is up."""
HOLD_S: Final = 1.0
"""The run ends when all robots have been at their goals for this long."""


@dataclass
class Session:
    """What the loop works with; a policy that is handed over exchanges mission and controller."""

    mission: Mission
    controller: Controller
    grid: DeadlineGrid
    timing: TimingRecord
    monitor: Monitor
    watch: Watch
    recorder: Recorder | None
    slopes: SlopeCheck | None
    """Samples the slopes of own objectives; nobody does where None."""
    dry_run: bool

    def take_over(self, takeover: Takeover | None) -> None:
        """Run the policy that was handed over, if that has not happened yet."""
        if takeover is None or takeover.controller is self.controller:
            return
        takeover.controller.succeed(self.controller)
        self.mission, self.controller = takeover.mission, takeover.controller
        self.monitor.take_over(len(self.controller.policy.schedule))
        if self.recorder:
            self.recorder.take_over(self.mission, self.controller)
        if not self.dry_run:  # a disk's time is not the loop's
            threading.Thread(target=_note, args=(self.mission,), daemon=True).start()


def _note(mission: Mission) -> None:
    """Remember which version is run; a disk that takes nothing stops no robot."""
    try:
        note_run(mission.bundle, mission.fleet, mission.robot_id)
    except EdgeError as error:
        complain("edge-run", str(error))


def drive(session: Session, bridge: Bridge, fleet: TeamLink, ending: Callable[[], str]) -> str:
    """Run the control loop until ``ending`` gives a reason, and return it."""
    grid, timing, monitor = session.grid, session.timing, session.monitor
    told = 0
    while not (reason := ending()):
        deadline_s = grid.wait()
        timing.begin(grid.due_s)
        own = fleet.locate(bridge.read(), deadline_s)
        if own is None:
            monitor.no_state()
            continue
        team = fleet.team(own)
        if guide := fleet.new_guide():
            session.take_over(fleet.takeover())
            session.controller.guide = guide
            session.watch.adopt(guide)
            monitor.judge_anew(guide, own.stamp_s)
        controller = session.controller
        timing.lap()
        team = controller.believe(team)
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
        monitor.update(team, guided, command, controller.unfamiliar)
        monitor.withheld = "" if session.dry_run else bridge.withholds
        session.watch.tell(team, guided, command)
        if session.slopes:
            session.slopes.check(controller.guide, team, guided.action)
        if session.recorder:
            session.recorder.record(deadline_s, team, observation, guided, command)
            for text in bridge.complaints[told:]:
                session.recorder.complain(text)
            told = len(bridge.complaints)
    return reason


def run(
    mission: Mission,
    controller: Controller,
    bridge: Bridge,
    fleet: TeamLink,
    signals: StopSignals,
    duration_s: float,
    *,
    dry_run: bool,
    early_wake_s: float | None = None,
    on_grid: bool = False,
    stay: bool = False,
    check_gradients: bool = False,
    recorder: Recorder | None = None,
) -> RunReport:
    """Drive the robot until goals are held, time is up, a signal or an operator ends it, or something fails.

    Args:
        mission: what the run is about.
        controller: of the mission's robot.
        bridge: to the robot; opened already.
        fleet: the robot's team; joined already.
        signals: end the run.
        duration_s: longest run.
        dry_run: command nothing.
        early_wake_s: how long before each tick one is computed to throw away; 0 for none; None: as pays.
        on_grid: ticks begin at their deadlines, not with the robot's poses.
        stay: goals that are held do not end the run.
        check_gradients: compare slopes of own objectives with finite differences; a wrong one ends the run.
        recorder: keeps the run's log; nobody does where None.

    Returns:
        What the run came to; ``failed`` where the link, the policy or the team ended it.
    """
    source = None if on_grid else fleet.poses(bridge)
    grid = _grid(mission, controller, bridge, fleet, source, early_wake_s)
    session = _prepare(mission, controller, bridge, grid, recorder, dry_run=dry_run)
    session.slopes = SlopeCheck() if check_gradients else None
    monitor = session.monitor

    def over() -> str:
        duration = DURATION if grid.next_s >= duration_s else ""
        reason = signals.reason or fleet.stop_reason
        return reason or ("goals held" if monitor.all_hold and not stay else duration)

    freeze_garbage()
    failure = ""
    with contextlib.closing(session.watch) as watch:
        try:
            with LiveLine(sys.stdout, mission.robot_id, monitor, grid):
                with signals.insist(duration_s):
                    reason = drive(session, bridge, fleet, over)
                bridge.stop(reason)
            if reason == DURATION and not monitor.saw_itself:
                raise BridgeError("the robot's own state was never known: ask edge-doctor")
        except (EdgeError, Overdue) as error:
            reason = failure = str(error)
        watch.end(reason)
    controller = session.controller
    driven = replace(session.mission, objective_set=controller.guide.asked)
    return make_report(
        driven,
        monitor,
        grid,
        session.timing,
        reason,
        bridge=bridge.name,
        complaints=bridge.complaints,
        backend=controller.policy.backend,
        dry_run=dry_run,
        failed=bool(failure),
        fleet=fleet.report(),
        log=recorder.end(reason, failed=bool(failure)) if recorder else None,
        stopping=stopping(driven, bridge.max_speed_m_s, bridge.reaction) if bridge.reaction else None,
    )


def _prepare(
    mission: Mission,
    controller: Controller,
    bridge: Bridge,
    grid: DeadlineGrid,
    recorder: Recorder | None,
    *,
    dry_run: bool,
) -> Session:
    hold_ticks = max(1, math.ceil(HOLD_S * mission.rate_hz))
    monitor = Monitor(mission.fleet, hold_ticks, len(controller.policy.schedule), mission.objective_set)
    timing = TimingRecord(STAGES)
    if recorder:
        recorder.begin(mission, controller, grid, timing, bridge=bridge.name, dry_run=dry_run)
    watch = open_watch(mission, monitor, grid, timing)
    return Session(mission, controller, grid, timing, monitor, watch, recorder, None, dry_run)


def _grid(
    mission: Mission,
    controller: Controller,
    bridge: Bridge,
    fleet: TeamLink,
    source: PoseSource | None,
    early_wake_s: float | None,
) -> DeadlineGrid:
    """Pace the ticks; where nothing real is driven, no early wake pays."""

    def prepare() -> None:
        fleet.receive()
        controller.rehearse()

    if early_wake_s is None and not bridge.reaction:
        early_wake_s = 0.0
    longest_gap_s = bridge.reaction.deadline_s if bridge.reaction else math.inf
    return StateGrid(mission.period_s, source, prepare, early_wake_s, longest_gap_s)
