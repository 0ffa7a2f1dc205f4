"""Checks of the team's network; nothing is sent but what connects and leaves a Zenoh session."""

import socket
from collections.abc import Iterator
from functools import partial

from edge_runtime.config.network import Endpoint, Robot, endpoint
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, examine, fail, ok
from edge_runtime.team.membership import Alone, open_fleet


def examine_team(mission: Mission, *, simulated: bool) -> Iterator[Finding]:
    """Check the robot's place among its neighbours; ``simulated`` teams live in one process."""
    if mission.fleet.carrier is None and simulated:
        yield examine("team", lambda: ok("simulated in one process"))
        return
    yield examine("team", partial(membership, mission))
    if mission.fleet.carrier is not None:
        yield examine("neighbours", partial(neighbours, mission))


def membership(mission: Mission) -> Finding:
    """Whether this machine has the robot's address, its port is free and the team's key is readable.

    Raises:
        ConfigError: names what is wrong in the fleet file or with the key.
    """
    with open_fleet(mission, Alone()):
        pass
    if mission.fleet.carrier is None:
        return ok("the only robot of its fleet")
    robot, carrier = mission.fleet.robot(mission.robot_id), mission.fleet.carrier
    places = " and ".join(filter(None, (robot.address, robot.zenoh)))
    router = f", router {carrier.router} answers" if carrier.router else ""
    return ok(f"{places}: this machine's and free, the key {carrier.key} is readable{router}")


def neighbours(mission: Mission) -> Finding:
    """Whether every robot that this one listens to lies on a network that its own address reaches."""
    fleet = mission.fleet
    own = fleet.robot(mission.robot_id)
    if fleet.carrier and fleet.carrier.router:
        return ok(f"the router {fleet.carrier.router} leads to them")
    wanted = own.neighbours
    others = [r for r in fleet.robots if r.id != own.id and (wanted is None or r.id in wanted)]
    lost = {other.id: cause for other in others if (cause := _unreachable(_place(own), _place(other)))}
    if lost:
        told = ", ".join(f"robot {robot_id} ({cause})" for robot_id, cause in lost.items())
        return fail(f"no route to {told}", "check the network, and `address` in the fleet file")
    places = ", ".join(other.zenoh or other.address or "" for other in others)
    return ok(f"routes lead to all {len(others)}: {places or 'none'}")


def _place(robot: Robot) -> Endpoint:
    """Return where a robot's teammates send its frames to."""
    return endpoint(robot.zenoh or robot.address or "")


def _unreachable(own: Endpoint, other: Endpoint) -> str:
    """Say why packets could not even leave for there; connecting a datagram socket sends nothing."""
    family = socket.AF_INET6 if ":" in own[0] else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((own[0], 0))
            probe.connect(other)
        except OSError as error:
            return error.strerror or str(error)
    return ""
