"""edge-pose: publishes the poses that robots ask for."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from edge_runtime.common.command_line import CommandParser, command, complain
from edge_runtime.common.flag_types import ipv4
from edge_runtime.common.signals import StopSignals
from edge_runtime.common.toml_file import refuse
from edge_runtime.config.fleet import Fleet, load_fleet
from edge_runtime.config.keys import team_key
from edge_runtime.config.network import Endpoint, endpoint
from edge_runtime.config.tracked import Tracked
from edge_runtime.errors import ConfigError
from edge_runtime.tools.pose.feeds import NatNetFeed, replay
from edge_runtime.tools.pose.recording import Sample, read_recording
from edge_runtime.tools.pose.stream_host import StreamHost

DESCRIPTION: Final = """\
Tell robots where they are: OptiTrack rigid bodies (NatNet 4.0 to 4.2) or a recording, as authenticated
frames. Serves the robots of the fleet file whose `pose` or `ranges` is its address, when they ask, and tells
all of them of the tracked objects whose `pose` that is."""
EPILOG: Final = """\
exit codes:
  0  the recording is over, or SIGTERM or SIGINT
  2  a flag or file does not hold together, or Motive does not answer; one line says what
  130  interrupted before poses were sent

examples:
  edge-pose --fleet team.toml --natnet 10.0.0.9
  edge-pose --fleet team.toml --replay poses.jsonl"""


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-pose", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("--fleet", type=Path, required=True, metavar="FILE", help="the team's fleet file")
    add("--key-file", type=Path, metavar="FILE", help="the team's key; default: the one that the fleet names")
    add("--listen", metavar="ADDRESS", help="which of the fleet's streams this is, if it names several")
    feed = parser.add_mutually_exclusive_group(required=True)
    feed.add_argument("--natnet", type=ipv4, metavar="IP", help="machine that runs Motive")
    feed.add_argument(
        "--replay",
        type=Path,
        metavar="FILE",
        help="JSON lines or .csv: t, robot or object, x, y[, z], heading[, vx, vy[, vz]]",
    )
    add("--up", choices=("y", "z"), default="y", help="axis that Motive streams as up (default: y)")
    return parser


def _place(fleet: Fleet, listen: str | None) -> Endpoint:
    """Return the address to serve, one that robots of the fleet name."""
    named = {robot.pose: robot.pose_place for robot in fleet.robots if robot.pose_place}
    named |= {robot.ranges: robot.ranges_place for robot in fleet.robots if robot.ranges_place}
    named |= {each.pose: each.pose_place for each in fleet.tracked if each.pose and each.pose_place}
    if not named:
        refuse(fleet.path, "robots", 'none names a stream; add pose = "10.0.0.5:47100" to each that has one')
    if listen is None and len(named) == 1:
        return next(iter(named.values()))
    try:
        place = endpoint(listen or "")
    except ValueError:
        place = None
    if place is None or place not in named.values():
        got = f", got {listen}" if listen else ""
        raise ConfigError(f"--listen must be one of the fleet's streams, {', '.join(named)}{got}")
    return place


def _check_robots(
    samples: Sequence[Sample],
    poses: Sequence[int],
    ranges: Sequence[int],
    objects: Sequence[str],
    flying: Sequence[int | str],
    file: Path,
) -> None:
    for sample in samples:
        if sample.object is not None:
            if sample.object not in objects:
                known = ", ".join(map(repr, objects)) or "none"
                raise ConfigError(f"{file}: object {sample.object!r} is not told from here; allowed: {known}")
            if sample.z is None and sample.object in flying:
                raise ConfigError(
                    f"{file}: object {sample.object!r} is among robots in space: its poses need z"
                )
        elif sample.robot not in (poses if sample.ranges is None else ranges):
            kind = "poses" if sample.ranges is None else "ranges"
            raise ConfigError(f"{file}: robot {sample.robot} does not get its {kind} from here")
        elif sample.ranges is None and (sample.z is None) == (sample.robot in flying):
            where = "in space: its poses need z" if sample.z is None else "in the plane: its poses have no z"
            raise ConfigError(f"{file}: robot {sample.robot} moves {where}")


def _check_bodies(fleet: Fleet, objects: Sequence[Tracked]) -> None:
    for each in objects:
        if each.rigid_body is None:
            key = f"tracked[{fleet.tracked.index(each)}].rigid_body"
            refuse(fleet.path, key, f"missing: which of Motive's rigid bodies is {each.name!r}?")


def _serve(flags: argparse.Namespace) -> None:
    fleet = load_fleet(flags.fleet)
    place = _place(fleet, flags.listen)
    key = team_key(fleet, flags.key_file)
    poses = [robot.id for robot in fleet.robots if robot.pose_place == place]
    ranges = [robot.id for robot in fleet.robots if robot.ranges_place == place]
    places = {robot.id: endpoint(robot.address) for robot in fleet.robots if robot.address}
    samples = read_recording(flags.replay) if flags.replay else []
    objects = [each for each in fleet.tracked if each.pose_place == place]
    names = [each.name for each in objects]
    flying: list[int | str] = [robot.id for robot in fleet.robots if len(robot.start_m) == 3]
    flying += names if flying else []
    _check_robots(samples, poses, ranges, names, flying, flags.replay)
    if flags.natnet:
        _check_bodies(fleet, objects)
    with StreamHost(place, places, poses, ranges, key, names) as host:
        if flags.replay:
            with StopSignals() as signals:
                replay(samples, host, lambda: signals.reason)
            return
        bodies: dict[int, int | str] = {
            r.id if r.rigid_body is None else r.rigid_body: r.id for r in fleet.robots if r.id in poses
        }
        bodies |= {each.rigid_body: each.name for each in objects if each.rigid_body is not None}
        with NatNetFeed(flags.natnet, bodies, flags.up, flying=flying) as feed, StopSignals() as signals:
            feed.publish(host, lambda: signals.reason)
            if feed.refused:
                complain("edge-pose", f"{feed.refused} packets were not NatNet")


@command("edge-pose")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-pose``; returns the exit code."""
    flags = make_parser().parse_args(arguments)
    _serve(flags)
    return 0


if __name__ == "__main__":
    sys.exit(main())
