"""Where the sockets of a team are on one machine."""

import contextlib
import socket
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec

HOST = "127.0.0.1"
TAKEN = "does something else run on this port?"


class Network(NamedTuple):
    """Where the robots' sockets are on this machine."""

    ports: Mapping[int, int]
    """Each robot's for UDP."""
    wires: Mapping[int, int]
    """Each firmware's."""
    relays: Mapping[int, int]
    """Where the others' datagrams to it go instead; empty without a relay."""
    zenoh: Mapping[int, int]
    """Each robot's for its links on Zenoh; empty on UDP."""
    tunnels: Mapping[tuple[int, int], int]
    """Where a robot finds another one, (connecting, listening), instead; empty without a relay."""
    stream: int
    """The world's, for poses and sensors."""


class Tunnel(msgspec.Struct, frozen=True):
    """A pair of robots on Zenoh with a relay between them."""

    connecting: int
    listening: int
    relay_port: int
    """Where the connecting robot finds the other one."""
    robot_port: int
    """Where that one listens."""


def free_ports(count: int) -> tuple[int, ...]:
    """Return ports of this machine that nobody holds now, neither for UDP nor for TCP; all differ."""
    found: dict[int, None] = {}
    while len(found) < count:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, socket.socket() as other:
            one.bind((HOST, 0))
            port = one.getsockname()[1]
            with contextlib.suppress(OSError):  # somebody's TCP port
                other.bind((HOST, port))
                found[port] = None
    return tuple(found)


def free_network(robots: Sequence[int], *, zenoh: bool, relayed: bool) -> Network:
    """Find ports for a team; ``relayed``: with a relay between the robots."""
    pairs = [(one, other) for one in robots for other in robots if other < one]
    relays = robots if relayed and not zenoh else ()
    places = robots if zenoh else ()
    tunnels = pairs if relayed and zenoh else []
    stream, *others = free_ports(1 + 2 * len(robots) + len(relays) + len(places) + len(tunnels))
    ports = iter(others)
    groups = (robots, robots, relays, places)
    own, wires, to_relays, on_places = (dict(zip(group, ports, strict=False)) for group in groups)
    return Network(own, wires, to_relays, on_places, dict(zip(tunnels, ports, strict=True)), stream)


def multicast_bus(port: int) -> str:
    """Return the address of a CAN bus between processes of this machine, one for each port."""
    return f"udp_multicast:239.75.{port >> 8}.{max(port & 0xFF, 1)}?port={port}"


def answers(port: int) -> bool:
    """Whether anybody takes connections at a port of this machine."""
    with contextlib.suppress(OSError), socket.create_connection((HOST, port)):
        return True
    return False
