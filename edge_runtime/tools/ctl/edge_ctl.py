"""edge-ctl: new objectives for a team that drives, its standing, and its stop."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

from edge_runtime.common.command_line import CommandParser, command, complain
from edge_runtime.common.flag_types import number
from edge_runtime.common.toml_file import read_settings, refuse
from edge_runtime.config.fleet import Fleet, load_fleet
from edge_runtime.config.keys import operator_key
from edge_runtime.config.network import endpoint
from edge_runtime.config.objectives import parse_objective_set
from edge_runtime.errors import ConfigError, FailedError
from edge_runtime.network.order_wire import FILE_BYTES, Standing
from edge_runtime.tools.ctl.operator_link import OperatorLink

DESCRIPTION: Final = """\
Order a team of robots that drive (edge-run with a fleet file that has a [carrier]):
  status           what each robot follows, its rate, and why it stands if it does
  objectives FILE  new objectives and guidance: all robots check them and change at one tick, or none does
  stop             all robots end their runs and are commanded to rest"""
EPILOG: Final = """\
exit codes:
  0  done, by every robot of the fleet
  1  a robot refused or did not answer; each one is named with the reason
  2  a flag or file does not hold together; one line says what, nothing was sent
  130  interrupted

examples:
  edge-ctl status --fleet team.toml
  edge-ctl objectives slow.toml --fleet team.toml
  edge-ctl stop --fleet team.toml"""
TIMEOUT: Final = number(0.1, 8.0)
"""In s; robots hold an accepted proposal for 10 s."""
LEAD_S: Final = 1.0
"""Time from the commitment to its tick, for lost packets to be repeated."""


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-ctl", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("action", choices=("status", "objectives", "stop"))
    add("file", nargs="?", type=Path, metavar="FILE", help="TOML of up to 8 KiB: [[objectives]], [guidance]")
    add("--fleet", type=Path, required=True, metavar="FILE", help="the team's fleet file")
    add("--key-file", type=Path, metavar="FILE", help="operator's key; default: the one that the fleet names")
    add("--timeout", type=TIMEOUT, default=3.0, metavar="S", help="wait for answers this long (default: 3)")
    return parser


def show_status(link: OperatorLink) -> int:
    """Print a line for each robot; succeed if all answered and follow the same."""
    silent = link.ask()
    width = max((len(standing.follows) for standing in link.standings.values()), default=0)
    print(f"robot  version  {'objectives':<{width}}  tick          Hz  driving")
    for robot_id in sorted((*link.standings, *silent)):
        standing = link.standings.get(robot_id)
        print(f"{robot_id:5}  {_line(standing, width) if standing else 'no answer'}")
    followed = {(standing.version, standing.digest) for standing in link.standings.values()}
    if len(followed) > 1:
        complain("edge-ctl", "the robots follow different objectives")
    return 1 if silent or len(followed) > 1 else 0


def _line(standing: Standing, width: int) -> str:
    driving = f"no: {standing.stop_reason}" if standing.stop_reason else "yes"
    rate = f"{standing.rate_hz:6.1f}" if standing.rate_hz else "     -"
    return f"{standing.version:7}  {standing.follows:<{width}}  {standing.tick:<8}{rate}  {driving}"


def change_objectives(link: OperatorLink, file: Path, content: bytes) -> int:
    """Have all robots accept the objectives, then commit them to one tick of the team."""
    if silent := link.ask():
        _fail("nothing was changed", dict.fromkeys(silent, "does not answer"))
    version = max(standing.version for standing in link.standings.values()) + 1
    try:
        unwilling = link.propose(version, file.name, content)
    except KeyboardInterrupt:
        link.abort()
        raise KeyboardInterrupt("interrupted, nothing was changed") from None
    if unwilling:
        causes = {robot: link.standings[robot] for robot in unwilling}
        link.abort()
        _fail("nothing was changed", {robot: _cause(causes[robot]) for robot in _blamed(causes)})
    tick = link.tick_in(LEAD_S)
    link.commit(tick)
    if late := link.applied(LEAD_S):
        why = f"has not confirmed version {version}; if it accepted, it follows its teammates"
        _fail(f"version {version} holds from tick {tick} on", dict.fromkeys(late, why))
    print(f"{len(link.standings)} robots follow version {version} from tick {tick} on")
    return 0


def _blamed(causes: dict[int, Standing]) -> list[int]:
    """Who refused; else who was too slow."""
    return [robot for robot, standing in causes.items() if standing.stage == "refused"] or list(causes)


def _cause(standing: Standing) -> str:
    return f"refuses: {standing.complaint}" if standing.stage == "refused" else "did not decide in time"


def stop_all(link: OperatorLink) -> int:
    """Stop every robot that can be reached."""
    if silent := link.stop():
        stopped = len(link.standings.keys() - set(silent))
        _fail(f"{stopped} robots stopped", dict.fromkeys(silent, "does not answer, and may drive"))
    print(f"{len(link.standings)} robots stopped")
    return 0


def _fail(outcome: str, robots: dict[int, str]) -> NoReturn:
    causes = "; ".join(f"robot {robot_id} {cause}" for robot_id, cause in sorted(robots.items()))
    raise FailedError(f"{outcome}{': ' if causes else ''}{causes}")


def _open(fleet: Fleet, key_file: Path | None, timeout_s: float) -> OperatorLink:
    key = operator_key(fleet, key_file)
    robots = {robot.id: endpoint(robot.address) for robot in fleet.robots if robot.address is not None}
    return OperatorLink(robots, key, timeout_s)


def _read_objectives(path: Path) -> bytes:
    """Read an objectives file that robots will accept as far as can be told here."""
    content = read_settings(path)
    if len(content) > FILE_BYTES:
        refuse(path, "", f"has {len(content)} bytes; robots take at most {FILE_BYTES}")
    parse_objective_set(content, path)
    return content


@command("edge-ctl")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-ctl``; returns the exit code."""
    flags = make_parser().parse_args(arguments)
    if (flags.action == "objectives") != (flags.file is not None):
        raise ConfigError("`objectives` needs a FILE, the other actions take none; see edge-ctl --help")
    content = _read_objectives(flags.file) if flags.file else b""
    try:
        with _open(load_fleet(flags.fleet), flags.key_file, flags.timeout) as link:
            if flags.action == "status":
                return show_status(link)
            return stop_all(link) if flags.action == "stop" else change_objectives(link, flags.file, content)
    except KeyboardInterrupt as interrupt:
        if interrupt.args:
            raise
        raise KeyboardInterrupt("interrupted; edge-ctl status shows what the robots follow") from None


if __name__ == "__main__":
    sys.exit(main())
