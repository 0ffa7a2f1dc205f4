"""edge-sil: real robot processes against firmware and a plant, judged before any wheel turns."""

import contextlib
import importlib.util
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, get_args

import msgspec

from edge_runtime.common.bounds import RATE_HZ
from edge_runtime.common.command_line import (
    CommandParser,
    begun,
    check_output,
    command,
    complain,
    write_report,
)
from edge_runtime.common.flag_types import number, whole_number
from edge_runtime.common.signals import StopSignals
from edge_runtime.config.fleet import TASKS
from edge_runtime.errors import ConfigError
from edge_runtime.run.console import use_colour
from firmware_bridge.sil.harness.harness import Harness
from firmware_bridge.sil.harness.lookout import StartError
from firmware_bridge.sil.harness.robots import check_robot
from firmware_bridge.sil.judge.evidence import gather
from firmware_bridge.sil.judge.judge import judge
from firmware_bridge.sil.judge.table import table
from firmware_bridge.sil.measurement.processes import ProcessGroup
from firmware_bridge.sil.report.records import SilReport
from firmware_bridge.sil.scenario.limits import DEFAULT_LIMITS
from firmware_bridge.sil.scenario.scenario import Request, Scenario, prepare
from firmware_bridge.sil.scenario.vehicle import BridgeKind
from firmware_bridge.simulation.plants import PLANTS

DESCRIPTION: Final = (
    "Run real robot processes against firmware and a plant, and judge them before any wheel turns."
)
EXIT_CODES: Final = {"passed": 0, "failed": 1, "invalid": 3}
ROBOTS: Final = whole_number(1, 64)
STARTS: Final = 3
BRIDGES: Final[tuple[str, ...]] = get_args(BridgeKind)
RATE: Final = 50.0
TASK_RATE: Final = 10.0
EPILOG: Final = """\
exit codes:
  0  passed: every limit was kept
  1  failed: a limit was broken, or a process died that nobody killed; one line says which
  2  a flag or file does not hold together; one line says what, nothing was started
  3  invalid: the machine was disturbed, the run proves nothing
  130  interrupted

examples:
  edge-sil                                                4 robots, CAN, 50 Hz, 30 s
  edge-sil --task balance                                 five robots and their load, at 10 Hz
  edge-sil --bridge mavlink --realtime --json run.json
  edge-sil --bridge ros1 --rate 20 --plant mujoco         Huskies behind a ROS of their own, wheels that slip
  edge-sil --robots 8 --rate 20 --faults blackout.toml
  edge-sil --fleet team.toml --policy policies/mine --limits strict.toml"""


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-sil", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("--robots", type=ROBOTS, metavar="N", help="how many (default: 4, or the fleet file's)")
    add("--bridge", choices=BRIDGES, default="can", help="what the robots speak (default: can)")
    add("--plant", choices=tuple(PLANTS), help="what moves them (default: the fleet file's, else discs)")
    add(
        "--rate",
        type=number(*RATE_HZ),
        metavar="HZ",
        help=f"control rate (default: {RATE:g}, with --task the policies' {TASK_RATE:g})",
    )
    seconds = number(1.0, 1e6)
    add("--duration", type=seconds, default=30.0, metavar="S", help="length of the measurement (default: 30)")
    add("--json", type=Path, metavar="FILE", help="write the report there")
    team = parser.add_mutually_exclusive_group()
    team.add_argument(
        "--fleet", type=Path, metavar="FILE", help="your team; its robots are moved to ports of this machine"
    )
    team.add_argument(
        "--task",
        choices=(*TASKS, "husky"),
        help="a packaged team; a workstation's VMAS moves balance and sampling, its MuJoCo husky",
    )
    add("--policy", type=Path, metavar="DIR", help="policy bundle; default: the fleet's")
    add("--faults", type=Path, metavar="FILE", help="timeline of [[fault]] tables")
    add("--limits", type=Path, default=DEFAULT_LIMITS, metavar="FILE", help=f"default: {DEFAULT_LIMITS.name}")
    rates = number(1.0, 1000.0)
    add("--pose-stream", type=rates, default=0.0, metavar="HZ", help="poses from a stream of this rate")
    add("--realtime", action="store_true", help="real-time scheduling for robots, guards and plant")
    add(
        "--ros-path",
        action="append",
        default=[],
        metavar="DIR",
        help="where rospy or rclpy lies, in place of the profile's folders; may be given several times",
    )
    add("--log-dir", type=Path, metavar="DIR", help="keep the robots' logs there")
    return parser


def parse(arguments: Sequence[str] | None) -> tuple[Request, Path | None]:
    """Read the command line; returns the request and where the report goes.

    Raises:
        ConfigError: names the flag and what is allowed.
    """
    flags = make_parser().parse_args(arguments)
    request = Request(
        robots=flags.robots,
        bridge=flags.bridge,
        plant=flags.plant,
        ros_path=tuple(flags.ros_path),
        rate_hz=flags.rate or (TASK_RATE if flags.task else RATE),
        duration_s=flags.duration,
        fleet=flags.fleet,
        task=flags.task,
        policy=flags.policy,
        faults=flags.faults,
        limits=flags.limits,
        realtime=flags.realtime,
        log_dir=flags.log_dir,
        pose_hz=flags.pose_stream,
    )
    return request, flags.json


def simulate(scenario: Scenario, signals: StopSignals) -> SilReport:
    """Run a scenario to its verdict; a team that does not come to drive is started again a few times.

    Raises:
        BridgeError: if the run could not be carried to its end; nothing is left running.
    """
    for start in range(STARTS):
        try:
            with ProcessGroup(scenario.folder) as processes:
                recording = Harness(scenario, processes, signals).run()
            return judge(scenario, recording)
        except StartError as error:
            if start == STARTS - 1:
                raise
            complain("edge-sil", f"{error}; starting again")
    raise AssertionError("the last start returns or raises")


@command("edge-sil")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-sil``; returns the exit code."""
    with contextlib.ExitStack() as stack:
        request, json = parse(arguments)
        _check_installed()
        _check_outputs(request, json)
        signals = stack.enter_context(StopSignals())  # before the folder: a signal leaves none behind
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="edge-sil-"))
        scenario = prepare(request, Path(folder))
        for station in scenario.stations:
            check_robot(scenario, station)
        evidence = gather(scenario, sys.argv[1:] if arguments is None else arguments)
        with begun():
            report = msgspec.structs.replace(simulate(scenario, signals), evidence=evidence)
            if json is not None:
                write_report("--json", json, report)
    print(table(report, colour=use_colour(sys.stdout)))
    return EXIT_CODES[report.verdict]


def _check_installed() -> None:
    missing = [name for name in ("msgpack", "tomli_w") if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigError(f"{', '.join(missing)} missing; run: pip install 'cfpg-edge[sil]'")


def _check_outputs(request: Request, json: Path | None) -> None:
    if json is not None:
        check_output("--json", json, (request.fleet, request.faults, request.limits))
    if request.log_dir is not None:
        try:
            request.log_dir.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=request.log_dir).close()
        except OSError as error:
            raise ConfigError(f"--log-dir {request.log_dir}: cannot be written ({error.strerror})") from error


if __name__ == "__main__":
    sys.exit(main())
