"""Before a robot is driven: does ROS's graph hold what the profile says? One line for each misfit."""

import math
import time
from typing import Final

from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.ros.client import Client, Graph
from firmware_bridge.ros.profile import RosProfile

ODOMETRY_TYPE: Final = "nav_msgs/Odometry"
STOP_TYPE: Final = "std_msgs/Bool"
ASK_AGAIN_S: Final = 0.1
_SHOWN: Final = 8


def expected_types(profile: RosProfile) -> dict[str, str]:
    """Return each topic's name and its type; names are absolute."""
    stop = {profile.emergency_stop: STOP_TYPE} if profile.emergency_stop else {}
    operators = dict.fromkeys(profile.operators, profile.type_name)
    return {profile.command: profile.type_name, profile.odometry: ODOMETRY_TYPE, **operators, **stop}


def check_graph(graph: Graph, profile: RosProfile, own_name: str) -> None:
    """Refuse a graph in which this node must not drive the robot.

    Raises:
        ConfigError: if a topic carries another type than the profile's.
        BridgeError: if this node's name is taken, others command the robot, or two nodes tell its odometry.
    """
    if own_name in graph.nodes:
        raise BridgeError(
            f"node {own_name} is there already: another edge-run drives this robot; "
            "one that was killed is forgotten within half a minute"
        )
    for name, expected in expected_types(profile).items():
        if others := [kind for kind in graph.topic(name).types if kind != expected]:
            raise ConfigError(
                f"{name} carries {', '.join(others)} here, --ros-profile says {expected}: "
                f"take the profile of this robot's software, or set `message` in a copy"
            )
    if rivals := graph.topic(profile.command).publishers:
        raise BridgeError(f"{rivals_said(rivals, profile.command)}: end it, or it will fight this guard")
    if len(tellers := graph.topic(profile.odometry).publishers) > 1:
        raise BridgeError(f"{profile.odometry} comes from {_listed(tellers)}: one robot has one odometry")


def discover(client: Client, profile: RosProfile, longest_s: float) -> Graph:
    """Ask for the graph until the robot is in it, and so long after that nobody new will be.

    Returns:
        The last one; the robot may be `missing` from it.

    Raises:
        ConfigError, BridgeError: as `check_graph`, as soon as it finds something.
    """
    now_s = time.monotonic()
    end_s, settled_s = now_s + longest_s, math.inf
    while True:
        graph = client.graph()
        check_graph(graph, profile, client.name)
        found, now_s = missing(graph, profile), time.monotonic()
        settled_s = math.inf if found else min(settled_s, now_s + client.settling_s)
        if now_s >= settled_s or (found and now_s >= end_s):
            return graph
        time.sleep(ASK_AGAIN_S)


def missing(graph: Graph, profile: RosProfile) -> str:
    """Say which side of the robot is not there; empty if it is whole."""
    if not graph.topic(profile.command).subscribers:
        return f"nobody listens on {profile.command}"
    if not graph.topic(profile.odometry).publishers:
        return f"nobody publishes {profile.odometry}"
    return ""


def lost(found: str, graph: Graph, profile: RosProfile, where: str) -> str:
    """Say what is not there and what is instead: the robots under other namespaces, or nobody at all."""
    tail = "/" + profile.command.rpartition("/")[2]
    heard = {name for name, topic in graph.topics.items() if topic.subscribers or topic.publishers}
    others = sorted(name for name in heard if name.endswith(tail) and name != profile.command)
    if others:
        return f"{found} ({where}), but there are {_listed(others)}: check --ros-namespace and --ros-profile"
    if heard:
        return f"{found} ({where}), only {_listed(sorted(heard))}: check --ros-namespace and --ros-profile"
    return f"{found}, and nobody else is there ({where}): start the robot's ROS, check network and domain"


def rivals_said(rivals: tuple[str, ...], topic: str) -> str:
    """Say who else commands the robot."""
    return f"{_listed(rivals)} publishes on {topic} too"


def _listed(names: "tuple[str, ...] | list[str]") -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
