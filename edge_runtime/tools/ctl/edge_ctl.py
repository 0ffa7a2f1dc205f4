"""edge-ctl: new objectives for a team that drives, its standing, and its stop."""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
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
from edge_runtime.policy.bundle import Bundle, load_bundle
from edge_runtime.policy.bundle_source import located
from edge_runtime.policy.signature import check_signature
from edge_runtime.team.handover import bundle_files
from edge_runtime.team.orders import policy_text
from edge_runtime.tools.ctl.operator_link import OperatorLink

DESCRIPTION: Final = """\
Order a team of robots that drive (edge-run with a fleet file that has a [carrier]):
  status           what each robot follows, its rate, and why it stands if it does
  objectives FILE  new objectives and guidance: all robots check them and change at one tick, or none does
  policy DIR       a signed bundle: all robots check it, stand, and run it from one tick on, or none does
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
  edge-ctl policy policies/navigation --fleet team.toml
  edge-ctl stop --fleet team.toml"""
TIMEOUT: Final = number(0.1, 8.0)
"""In s; robots hold an accepted proposal for 10 s."""
LEAD_S: Final = 1.0
"""Time from the commitment to its tick, for lost packets to be repeated."""


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-ctl", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("action", choices=("status", "objectives", "policy", "stop"))
    add(
        "file",
        nargs="?",
        type=Path,
        metavar="FILE|DIR",
        help="TOML of up to 8 KiB: [[objectives]], [guidance]; or a bundle's directory",
    )
    add("--fleet", type=Path, required=True, metavar="FILE", help="the team's fleet file")
    add("--key-file", type=Path, metavar="FILE", help="operator's key; default: the one that the fleet names")
    add("--timeout", type=TIMEOUT, default=3.0, metavar="S", help="wait for answers this long (default: 3)")
    return parser


def show_status(link: OperatorLink) -> int:
    """Print a line for each robot; succeed if all answered and follow the same."""
    silent = link.ask()
    rows = [_row(robot_id, link.standings.get(robot_id)) for robot_id in sorted((*link.standings, *silent))]
    rows.insert(0, ("robot", "policy", "version", "objectives", "tick", "Hz", "driving"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    followed = {(standing.version, standing.digest) for standing in link.standings.values()}
    if len(followed) > 1:
        complain("edge-ctl", "the robots follow different objectives")
    return 1 if silent or len(followed) > 1 else 0


def _row(robot_id: int, standing: Standing | None) -> tuple[str, ...]:
    if standing is None:
        return str(robot_id), "no answer", *("",) * 5
    return (
        str(robot_id),
        standing.policy,
        str(standing.version),
        standing.follows,
        str(standing.tick),
        f"{standing.rate_hz:.1f}" if standing.rate_hz else "-",
        f"no: {standing.stop_reason}" if standing.stop_reason else "yes",
    )


def change_objectives(link: OperatorLink, file: Path, content: bytes) -> int:
    """Have all robots accept the objectives, then commit them to one tick of the team."""
    if silent := link.ask():
        _fail("nothing was changed", dict.fromkeys(silent, "does not answer"))
    version = _next_version(link)
    try:
        unwilling = link.propose(version, file.name, content)
    except KeyboardInterrupt:
        link.abort()
        raise KeyboardInterrupt("interrupted, nothing was changed") from None
    if unwilling:
        _take_back(link, unwilling)
    tick = _commit(link, version)
    print(f"{len(link.standings)} robots follow version {version} from tick {tick} on")
    return 0


def hand_over(link: OperatorLink, bundle: Bundle) -> int:
    """Have all robots accept a policy and stand, then commit it to one tick of the team."""
    if silent := link.ask():
        _fail("nothing was changed", dict.fromkeys(silent, "does not answer"))
    version = _next_version(link)
    try:
        if unwilling := link.offer(version, bundle_files(bundle)):
            _take_back(link, unwilling)
        if moving := link.halt():
            link.abort()
            _fail("nothing was changed", dict.fromkeys(moving, "does not come to rest"))
    except KeyboardInterrupt:
        link.abort()
        raise KeyboardInterrupt("interrupted, nothing was changed") from None
    tick = _commit(link, version)
    count, policy = len(link.standings), policy_text(bundle)
    print(f"{count} robots run {policy} from tick {tick} on, as the team's version {version}")
    return 0


def _next_version(link: OperatorLink) -> int:
    return max(standing.version for standing in link.standings.values()) + 1


def _take_back(link: OperatorLink, unwilling: Sequence[int]) -> NoReturn:
    """Take back what was proposed, and name who would not have it."""
    causes = {robot: link.standings[robot] for robot in unwilling}
    link.abort()
    _fail("nothing was changed", {robot: _cause(causes[robot]) for robot in _blamed(causes)})


def _commit(link: OperatorLink, version: int) -> int:
    """Commit what all accepted to a tick of the team, and return it."""
    tick = link.tick_in(LEAD_S)
    link.commit(tick)
    if late := link.applied(LEAD_S):
        why = f"has not confirmed version {version}; if it accepted, it follows its teammates"
        _fail(f"version {version} holds from tick {tick} on", dict.fromkeys(late, why))
    return tick


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


def _read_policy(path: Path, fleet: Fleet) -> Bundle:
    """Read a bundle that robots will run as far as can be told here."""
    bundle, keys = load_bundle(located(str(path))), fleet.team.trusted_keys
    if not keys:
        refuse(fleet.path, "team.trusted_keys", "missing: robots take no policy that nobody vouches for")
    check_signature(bundle.directory, bundle.sha256, keys)
    return bundle


def _read_objectives(path: Path) -> bytes:
    """Read an objectives file that robots will accept as far as can be told here."""
    content = read_settings(path)
    if len(content) > FILE_BYTES:
        refuse(path, "", f"has {len(content)} bytes; robots take at most {FILE_BYTES}")
    parse_objective_set(content, path)
    return content


def _chosen(flags: argparse.Namespace, fleet: Fleet) -> Callable[[OperatorLink], int]:
    """What is to be done, once all that the flags name is read."""
    if flags.action == "objectives":
        return partial(change_objectives, file=flags.file, content=_read_objectives(flags.file))
    if flags.action == "policy":
        return partial(hand_over, bundle=_read_policy(flags.file, fleet))
    return show_status if flags.action == "status" else stop_all


@command("edge-ctl")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-ctl``; returns the exit code."""
    flags = make_parser().parse_args(arguments)
    if (flags.action in ("objectives", "policy")) != (flags.file is not None):
        raise ConfigError("`objectives` needs a FILE, `policy` a DIR, others none; see edge-ctl --help")
    fleet = load_fleet(flags.fleet)
    act = _chosen(flags, fleet)
    try:
        with _open(fleet, flags.key_file, flags.timeout) as link:
            return act(link)
    except KeyboardInterrupt as interrupt:
        if interrupt.args:
            raise
        raise KeyboardInterrupt("interrupted; edge-ctl status shows what the robots follow") from None


if __name__ == "__main__":
    sys.exit(main())
