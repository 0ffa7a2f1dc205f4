"""The command line of edge-run, and the mission that its flags describe."""

import argparse
import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Final

from edge_runtime.common.bounds import RATE_HZ
from edge_runtime.common.command_line import CommandParser
from edge_runtime.common.flag_types import number, whole_number
from edge_runtime.config.fleet import DEFAULT_FLEET, FLEETS, TASKS, Fleet, load_fleet
from edge_runtime.config.network import Robot
from edge_runtime.config.objectives import load_objective_set
from edge_runtime.config.own_sources import add_own_source, load_own_sources
from edge_runtime.control.mission import Mission, adapted
from edge_runtime.control.trust import require_trusted
from edge_runtime.policy.backend import BACKENDS
from edge_runtime.policy.bundle import Bundle, load_bundle, packaged_bundle
from edge_runtime.policy.bundle_source import located
from edge_runtime.recording.flags import add_log_flags
from edge_runtime.run.bridges import BRIDGES

DESCRIPTION: Final = """\
Drive one robot of a team by a flow policy, steered by objectives that it never saw in training.
With no other flags: the packaged policy, a built-in fleet of four robots, a simulated team."""
EPILOG: Final = """\
exit codes:
  0  the run ended: goals held, --duration over, SIGTERM or SIGINT; the robot was commanded to rest
  1  the link to the robot failed during the run, or the policy did; the robot was stopped; or a report or
     picture of the run could not be written
  2  a flag, file or bundle does not hold together; one line says what, nothing was commanded
  130  interrupted before the run began

examples:
  edge-run --robot-id 0
  edge-run --robot-id 0 --task balance    a team carries a package, on a workstation
  edge-run --robot-id 2 --fleet fleet.toml --policy policies/navigation --json run.json
  edge-run --robot-id 0 --objectives slow.toml --duration 20
  edge-run --robot-id 0 --no-guidance     what the policy does by itself
  edge-run --robot-id 0 --dry-run         compute everything, command nothing
  edge-run --robot-id 0 --animate run.gif
  edge-run --robot-id 0 --bridge can --bus can0 --profile agilex_v2 --rate 50 --arm
  edge-run --robot-id 0 --bridge mavlink --help"""

LARGEST_SEED: Final = 2**63 - 1
"""What a log's integers hold."""


def make_parser(*, robot_required: bool = True) -> CommandParser:
    """The command line, without the flags of any bridge."""
    parser = CommandParser("edge-run", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("--robot-id", type=int, required=robot_required, metavar="I", help="which robot of the fleet this is")
    team = parser.add_mutually_exclusive_group()
    team.add_argument(
        "--fleet",
        type=Path,
        default=DEFAULT_FLEET,
        metavar="FILE",
        help="TOML: team, robots, objectives, guidance",
    )
    team.add_argument(
        "--task",
        choices=(*TASKS, "husky"),
        help="a packaged fleet file instead (navigation); VMAS moves balance and sampling, MuJoCo husky",
    )
    add("--policy", type=Path, metavar="DIR", help="policy bundle, or hf://owner/name; default: the fleet's")
    add(
        "--allow-rollback",
        action="store_true",
        help="run a signed policy that is older than one that this robot has run",
    )
    add(
        "--bridge",
        choices=tuple(BRIDGES),
        default="sim",
        help="link to the robot (default: sim, all in this process); with --help shows the link's own flags",
    )
    add(
        "--rate",
        type=number(*RATE_HZ),
        metavar="HZ",
        help="control rate; default: the fleet's, else the policy's",
    )
    add(
        "--duration",
        type=number(0.001, 1e9),
        default=60.0,
        metavar="S",
        help="longest run in s (default: 60)",
    )
    add(
        "--stay",
        action="store_true",
        help="drive on when all robots hold their goals, until --duration is over",
    )
    add("--objectives", type=Path, metavar="FILE", help="TOML: replaces the fleet's objectives and guidance")
    add(
        "--no-guidance",
        action="store_true",
        help="let the flow alone; the report still judges the objectives",
    )
    add(
        "--backend",
        choices=BACKENDS,
        default="auto",
        help="what computes the policy (default: auto, the compiled kernel where it works, else numpy)",
    )
    add(
        "--early-wake",
        type=number(0.0, 100.0),
        metavar="MS",
        help="wake this long before each tick and compute one to throw away; 0: not at all "
        "(default: as long as that takes, where it takes little)",
    )
    add(
        "--realtime",
        action="store_true",
        help="run ahead of all ordinary processes (SCHED_FIFO) with locked memory; needs the rights",
    )
    add(
        "--check-gradients",
        action="store_true",
        help="compare the slope of an own objective with finite differences of its cost in every tick; a "
        "wrong one ends the run",
    )
    add(
        "--start",
        choices=("state", "grid"),
        default="state",
        help="what a tick begins with: the robot's newest pose, or its deadline (default: state)",
    )
    add("--dry-run", action="store_true", help="compute everything, command nothing")
    add(
        "--seed",
        type=whole_number(0, LARGEST_SEED),
        default=0,
        metavar="N",
        help="of the flow's start noise, where guidance asks for it (default: 0)",
    )
    add("--json", type=Path, metavar="FILE", help="write the report there")
    add("--animate", type=Path, metavar="FILE", help="when it ended, draw the run: .gif, or .mp4 with ffmpeg")
    add_own_source(parser)
    add_log_flags(parser)
    return parser


def read_flags(
    arguments: Sequence[str] | None, parser: CommandParser | None = None
) -> tuple[argparse.Namespace, ModuleType]:
    """Read a command line with the flags of the bridge that it names; returns them and the bridge's module.

    Args:
        arguments: the process's own where None.
        parser: one of `make_parser`.

    Raises:
        ConfigError: says which flag is wrong.
    """
    parser = parser or make_parser()
    chosen = CommandParser(parser.prog, add_help=False)
    chosen.add_argument("--bridge", choices=tuple(BRIDGES), default="sim")
    bridge = chosen.parse_known_args(arguments)[0].bridge
    link = importlib.import_module(BRIDGES[bridge].bridge)
    link.add_arguments(parser)
    return parser.parse_args(arguments), link


def named_fleet(flags: argparse.Namespace) -> Fleet:
    """Read the fleet file that the flags name: one of the user's, or a packaged task's.

    Raises:
        ConfigError: if it does not hold together.
    """
    return load_fleet(FLEETS / f"{flags.task}.toml" if flags.task else flags.fleet)


def make_mission(flags: argparse.Namespace) -> Mission:
    """Read and check every file that the flags name.

    Raises:
        EdgeError: one line that says what does not hold together.
    """
    fleet = named_fleet(flags)
    objective_set = load_objective_set(flags.objectives) if flags.objectives else fleet.objective_set
    robot = fleet.robot(flags.robot_id)
    bundle = load_bundle(located(str(flags.policy))) if flags.policy else _fleet_bundle(fleet, robot)
    require_trusted(bundle, fleet, robot.id, allow_rollback=flags.allow_rollback)
    bundle = adapted(bundle, robot, fleet.team)
    rate_hz = flags.rate or fleet.team.rate_hz or bundle.manifest.control_rate_hz
    return Mission(
        flags.robot_id,
        fleet,
        bundle,
        objective_set,
        rate_hz,
        flags.seed,
        guided=not flags.no_guidance,
        backend=flags.backend,
        own_sources=load_own_sources(fleet, flags.own_source),
    )


def _fleet_bundle(fleet: Fleet, robot: Robot) -> Bundle:
    name = robot.policy or fleet.team.policy
    return load_bundle(located(name, fleet.path.parent)) if "/" in name else packaged_bundle(name)
