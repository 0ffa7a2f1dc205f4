"""Checks of a whole fleet from one machine: each robot by the file, and what those that run answer."""

import argparse
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

from edge_runtime.config.fleet import Fleet
from edge_runtime.config.keys import operator_key
from edge_runtime.config.network import endpoint
from edge_runtime.control.doubts import doubts
from edge_runtime.doctor.finding import Finding, examine, fail, ok, warn
from edge_runtime.errors import ConfigError
from edge_runtime.network.order_wire import Standing
from edge_runtime.run.flags import make_mission, named_fleet
from edge_runtime.tools.ctl.operator_link import OperatorLink

ANSWER_S: Final = 1.0
"""A robot that drives answers in milliseconds."""


def examine_fleet(flags: argparse.Namespace) -> Iterator[Finding]:
    """Check every robot of a fleet file with the flags of edge-run.

    Raises:
        ConfigError: if the fleet file does not hold together.
    """
    return _examine(flags, named_fleet(flags))


def _examine(flags: argparse.Namespace, fleet: Fleet) -> Iterator[Finding]:
    for robot in fleet.robots:
        yield examine(f"robot {robot.id}", partial(place, flags, robot.id))
    yield examine("hearing", partial(hearing, fleet))
    if fleet.carrier is not None:
        yield from _answers(fleet)


def place(flags: argparse.Namespace, robot_id: int) -> Finding:
    """Whether what a robot is to run holds together.

    Raises:
        EdgeError: names what does not.
    """
    mission = make_mission(argparse.Namespace(**{**vars(flags), "robot_id": robot_id}))
    mission.controller(robot_id)
    manifest, asked = mission.bundle.manifest, mission.objective_set.text
    told = (
        f"policy {manifest.name} {mission.bundle.sha256[:12]} at {mission.rate_hz:g} Hz, objectives {asked}"
    )
    found = "; ".join(doubts(mission))
    return warn(f"{told}; {found}", "") if found else ok(told)


def hearing(fleet: Fleet) -> Finding:
    """Whether every robot is listened to by another one: nobody steers clear of one that nobody hears."""
    ids = [robot.id for robot in fleet.robots]
    heard = {
        other
        for robot in fleet.robots
        for other in (ids if robot.neighbours is None else robot.neighbours)
        if other != robot.id
    }
    lonely = [str(robot_id) for robot_id in ids if robot_id not in heard and len(ids) > 1]
    if lonely:
        return warn(
            f"nobody listens to robot {', '.join(lonely)}",
            "name it among the `neighbours` of those it may meet",
        )
    return ok(f"each of {len(ids)} robots is listened to" if len(ids) > 1 else "the only robot of its fleet")


def _answers(fleet: Fleet) -> Iterator[Finding]:
    """Ask all robots; what each one says, and whether they follow the same."""
    robots = {robot.id: endpoint(robot.address) for robot in fleet.robots if robot.address is not None}
    try:
        key = operator_key(fleet)
    except ConfigError as error:
        cause = str(error)
        yield examine("answers", lambda: fail(cause))
        return
    with OperatorLink(robots, key, ANSWER_S) as link:
        link.ask()
        standings = dict(link.standings)
    for robot_id in sorted(robots):
        yield examine(f"answer of {robot_id}", partial(answer, standings.get(robot_id)))
    if standings:
        yield examine("agreement", partial(agreement, list(standings.values())))


def answer(standing: Standing | None) -> Finding:
    """What a robot says of itself; one that is silent may well not be running yet."""
    if standing is None:
        return warn("none", "it does not run, or lies behind another network, firewall or key")
    driving = f"stands: {standing.stop_reason}" if standing.stop_reason else "drives"
    rate = f"{standing.rate_hz:.1f} Hz of {standing.nominal_rate_hz:g} Hz"
    return ok(f"{driving}; {rate}, follows set {standing.version}: {standing.follows}")


def agreement(standings: Sequence[Standing]) -> Finding:
    """Whether those that answer follow the same objectives."""
    sets = {(standing.version, standing.digest) for standing in standings}
    if len(sets) > 1:
        return fail(f"{len(standings)} robots follow {len(sets)} different sets", "see edge-ctl status")
    return ok(f"the {len(standings)} that answer follow the same objectives")
