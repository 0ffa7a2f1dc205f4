"""edge-run: drives one robot of a team by a guided flow policy."""

import contextlib
import importlib
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType

from edge_runtime.common.command_line import begun, check_output, command, complain, write_report
from edge_runtime.common.realtime import enter_realtime, switch_threads_often
from edge_runtime.common.signals import StopSignals
from edge_runtime.control.doubts import doubts
from edge_runtime.control.trust import note_run
from edge_runtime.errors import FailedError
from edge_runtime.recording.recorder import open_record
from edge_runtime.run.bridges import BRIDGES
from edge_runtime.run.console import summary, use_colour
from edge_runtime.run.final_output import say
from edge_runtime.run.flags import make_mission, read_flags
from edge_runtime.run.loop import run
from edge_runtime.run.run_report import RunReport
from edge_runtime.team.membership import Alone, open_fleet


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
    if report.failed or report.objective_fault:
        raise FailedError(report.stop_reason if report.failed else report.objective_fault)
    return 0


def _open(
    arguments: Sequence[str] | None, opening: contextlib.ExitStack
) -> tuple[Callable[[], RunReport], Namespace]:
    """Check all that the command line names and open the links; returns what drives, and the flags."""
    switch_threads_often()
    signals = opening.enter_context(StopSignals())
    flags, link = read_flags(arguments)
    mission = make_mission(flags)
    if flags.json:
        check_output("--json", flags.json, (flags.objectives, flags.fleet))
    if flags.animate:
        _animation().check_animation(flags.animate, recorded=flags.log)
    for doubt in doubts(mission):
        complain("edge-run", doubt)
    bridge = link.open_bridge(mission, link.options_from(flags))
    # What cannot compute is refused before a link opens.
    most = bridge.max_speed_m_s, bridge.max_yaw_rate_rad_s
    controller = mission.controller(mission.robot_id, *most)
    recorder = opening.enter_context(open_record(flags))
    if flags.realtime:
        enter_realtime()  # before the bridge opens: its guard process inherits it
    local = bridge if BRIDGES[flags.bridge].simulated else Alone()
    # Entered last, left first: the robot is stopped before it leaves its team.
    fleet = opening.enter_context(open_fleet(mission, local, *most))
    opening.enter_context(bridge)
    if not flags.dry_run:
        note_run(mission.bundle, mission.fleet, mission.robot_id)
    drive_robot = partial(
        run,
        mission,
        controller,
        bridge,
        fleet,
        signals,
        flags.duration,
        dry_run=flags.dry_run,
        early_wake_s=None if flags.early_wake is None else 1e-3 * flags.early_wake,
        on_grid=flags.start == "grid",
        stay=flags.stay,
        check_gradients=flags.check_gradients,
        recorder=recorder,
    )
    return drive_robot, flags


def _animation() -> ModuleType:
    """Load what draws only where it is wanted: it needs an extra."""
    return importlib.import_module("edge_runtime.tools.report.animate")


if __name__ == "__main__":
    sys.exit(main())
