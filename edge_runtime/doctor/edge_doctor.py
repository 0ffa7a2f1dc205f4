"""edge-doctor: looks at everything that a run rests on, before anybody arms; it commands nothing."""

import argparse
import importlib
import sys
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Final

from edge_runtime.common.command_line import CommandParser, command
from edge_runtime.control.doubts import doubts
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, line, ok, warn
from edge_runtime.doctor.fleet import examine_fleet
from edge_runtime.doctor.machine import examine_machine
from edge_runtime.doctor.objectives import examine_objectives
from edge_runtime.doctor.policy import examine_policy
from edge_runtime.doctor.team import examine_team
from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.recording.flags import make_log_plan
from edge_runtime.run.bridges import BRIDGES
from edge_runtime.run.console import use_colour
from edge_runtime.run.flags import make_mission, read_flags
from edge_runtime.run.flags import make_parser as make_run_parser

DESCRIPTION: Final = """\
Check everything that edge-run with the same flags rests on: policy, machine, team, bus and firmware.
Copy the command line of edge-run; nothing is armed, enabled or commanded, and no report is written."""
EPILOG: Final = """\
exit codes:
  0  nothing failed; there may be warnings
  1  at least one check failed, or was not made
  2  a flag or file does not hold together; one line says what, nothing was checked
  130  interrupted

examples:
  edge-doctor --robot-id 0
  edge-doctor --whole-fleet --fleet team.toml
  edge-doctor --robot-id 0 --bridge can --bus can0 --profile agilex_v2 --rate 50 --arm"""


def examine_all(flags: argparse.Namespace, options: object) -> Iterator[Finding]:
    """Yield what each check finds, as soon as it is found.

    Raises:
        ConfigError: at once, if flags and files do not fit together.
    """
    machine = _examine_machine(flags)
    try:
        mission = make_mission(flags)
    except BundleError as error:
        cause = str(error)  # the checks of team and link need the policy's limits and rate
        return chain(machine, [examine("bundle", lambda: fail(cause, "what rests on it was not checked"))])
    modules = BRIDGES[flags.bridge]
    return chain(
        machine,
        examine_policy(mission),
        examine_objectives(mission),
        [examine("numbers", partial(numbers, mission))],
        examine_team(mission, simulated=modules.simulated),
        _examine_link(modules.checks, mission, options),
    )


def numbers(mission: Mission) -> Finding:
    """Whether rate, limits and goals are of the order of what the policy has seen."""
    found = "; ".join(doubts(mission))
    return warn(found, "") if found else ok("rate, limits and goals are of the policy's order")


def _examine_machine(flags: argparse.Namespace) -> Iterator[Finding]:
    plan = make_log_plan(flags) if flags.log else None
    return examine_machine(
        wants_realtime=flags.realtime,
        reports=flags.json.absolute().parent if flags.json else None,
        logs=Path(plan.folder) if plan else None,
        logs_bytes=plan.keep_bytes if plan else 0,
    )


def _examine_link(module: str, mission: Mission, options: object) -> Iterator[Finding]:
    if not module:
        return iter(())
    findings: Iterator[Finding] = importlib.import_module(module).examine_link(mission, options)
    return findings


def show(findings: Iterable[Finding], *, colour: bool) -> bool:
    """Print each finding as it comes, then how many there were; whether none of them failed."""
    counts = dict.fromkeys(Verdict, 0)
    for finding in findings:
        print(line(finding, colour=colour), flush=True)
        counts[finding.verdict] += 1
    warnings, failures = counts[Verdict.WARN], counts[Verdict.FAIL]
    print(f"{sum(counts.values())} checks: {failures} failed, {warnings} warned")
    return failures == 0


def make_parser() -> CommandParser:
    """The command line of edge-run, and the doctor's own flag."""
    parser = make_run_parser(robot_required=False)
    parser.prog, parser.description, parser.epilog = "edge-doctor", DESCRIPTION, EPILOG
    parser.add_argument(
        "--whole-fleet",
        action="store_true",
        help="check each robot's place in the fleet file, and ask those that run what they follow",
    )
    return parser


@command("edge-doctor")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-doctor``; returns the exit code."""
    flags, link = read_flags(arguments, make_parser())
    if flags.whole_fleet == (flags.robot_id is not None):
        raise ConfigError("one of --robot-id and --whole-fleet is needed; see edge-doctor --help")
    findings = examine_fleet(flags) if flags.whole_fleet else examine_all(flags, link.options_from(flags))
    try:
        return 0 if show(findings, colour=use_colour(sys.stdout)) else 1
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted, not everything was checked") from None


if __name__ == "__main__":
    sys.exit(main())
