"""edge-watch: the whole team in a terminal, in a process of its own."""

import argparse
import contextlib
import importlib
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from edge_runtime.common.command_line import CommandParser, command, complain, need
from edge_runtime.common.signals import StopSignals
from edge_runtime.common.toml_file import refuse
from edge_runtime.config.fleet import Fleet, load_fleet
from edge_runtime.config.keys import team_key
from edge_runtime.config.network import endpoint
from edge_runtime.tools.watch import plain
from edge_runtime.tools.watch.feed import Feed
from edge_runtime.tools.watch.team import WatchedTeam

DESCRIPTION: Final = """\
Show every robot of a team: goals, speed and separation against their limits, rates and missed deadlines,
costs of the objectives, conflicts, times of each stage, ages of messages, why a robot stands.
It runs on the machine that [watch] of the fleet file names; robots send there and never listen to it.
Several may run there at once: the first one passes on what it hears."""
EPILOG: Final = """\
columns:
  state    driving, stopped (the reason is below), ended and why, silent for a second or more, or a clock that
           is far off: then it may be a recording
  speed, nearest, rate   measured / limit, margin, asked for
  set      version of the objectives that the robot follows
  cost     for each objective: what it asks, its cost (0: kept), share of steps in conflict with another
  p50/p99  of the last 2 s, for the tick and each of its stages
  age      of what each robot knew of the others in its newest tick

keys: q or Ctrl-C ends

exit codes:
  0  ended by q, Ctrl-C or SIGTERM; with --once: every robot was heard
  1  with --once: a robot was not heard
  2  a flag, file or address does not hold together; one line says what

examples:
  edge-watch --fleet team.toml --key-file team.key
  edge-watch --fleet team.toml --once               a script asks: is everybody there?
  edge-watch --fleet team.toml | tee team.log       plain lines, one a robot and second
  ssh -t station edge-watch --fleet team.toml       over ssh, which needs -t for a terminal
  python -m edge_runtime.tools.watch --fleet team.toml    the same command"""
PLAIN_S: Final = 1.0
ONCE_S: Final = 3.0
"""Longest wait of --once: a robot talks five times a second."""


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = CommandParser("edge-watch", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("--fleet", type=Path, required=True, metavar="FILE", help="TOML: the team, with [watch] address")
    add("--key-file", type=Path, metavar="FILE", help="the team's key; default: the one the fleet file names")
    add("--once", action="store_true", help=f"print the team when all were heard or {ONCE_S:g} s passed")
    return parser


def open_watch(fleet: Fleet, key_file: Path | None) -> tuple[WatchedTeam, Feed]:
    """Open what the robots send to.

    Raises:
        ConfigError: if the fleet names no watcher, the key cannot be used, or the address is not ours.
    """
    if fleet.watch is None:
        refuse(fleet.path, "watch", 'missing; add [watch] address = "10.0.0.5:47900", this machine\'s')
    key, place = team_key(fleet, key_file), endpoint(fleet.watch.address)
    feed = Feed(place, key)
    if not feed.first_hand:
        complain("edge-watch", f"another edge-watch holds {fleet.watch.address}, and passes on what it hears")
    return WatchedTeam((robot.id for robot in fleet.robots), key), feed


def print_lines(team: WatchedTeam, feed: Feed, ended: Callable[[], bool]) -> None:
    """Print a line for each robot, each second."""
    due_s = time.monotonic() + PLAIN_S
    while not ended():
        _receive(team, feed, due_s)
        if time.monotonic() >= due_s:
            due_s += PLAIN_S
            print(*plain.lines(team), sep="\n", flush=True)


def print_once(team: WatchedTeam, feed: Feed, ended: Callable[[], bool]) -> bool:
    """Print a line for each robot as soon as all were heard; whether they were."""
    until_s = time.monotonic() + ONCE_S
    while not ended() and not team.all_heard and time.monotonic() < until_s:
        _receive(team, feed, until_s)
    print(*plain.lines(team), sep="\n", flush=True)
    return team.all_heard


def _receive(team: WatchedTeam, feed: Feed, until_s: float) -> None:
    """Wait for packets, not beyond a time, and take them in."""
    feed.wait(min(0.2, until_s - time.monotonic()))
    team.receive(feed)


@command("edge-watch")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-watch``; returns the exit code."""
    flags = make_parser().parse_args(arguments)
    fleet = load_fleet(flags.fleet)
    on_screen = not flags.once and _draws()
    if on_screen:
        need("rich", "watch")
    team, feed = open_watch(fleet, flags.key_file)
    with feed, StopSignals() as signals:

        def ended() -> bool:
            return bool(signals.reason)

        if flags.once:
            return 0 if print_once(team, feed, ended) else 1
        if on_screen:
            screen = importlib.import_module("edge_runtime.tools.watch.screen")  # needs rich
            screen.watch_on_screen(team, feed, fleet.path.name, ended)
        else:
            with contextlib.suppress(BrokenPipeError):  # an end like any other
                print_lines(team, feed, ended)
    return 0


def _draws() -> bool:
    """Whether standard output is a terminal that can place text."""
    return sys.stdout.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")


if __name__ == "__main__":
    sys.exit(main())
