"""A ROS of a run's own: a master at a port of this machine, or a domain that nobody on it uses."""

import importlib.machinery
import random
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec

from edge_runtime.errors import ConfigError
from firmware_bridge.sil.scenario.ports import HOST, free_ports

DOMAINS: Final = range(1, 101)
"""Those whose ports no system gives away by itself."""
_FIRST_PORT, _DOMAIN_PORTS, _UNICAST = 7400, 250, 10
"""Of RTPS 2.2, 9.6.1.1: where the first participant of a domain hears the others."""


class RosPlace(msgspec.Struct, frozen=True):
    """Where it is."""

    environment: dict[str, str] = {}
    """By which whoever is of it finds the others."""
    port: int = 0
    """Of its master; 0 where there is none."""


def free_ros(ros: Literal[1, 2], folder: Path) -> RosPlace:
    """Find a place for a ROS; its logs go to ``folder``."""
    home = {"ROS_HOME": str(folder), "ROS_LOG_DIR": str(folder)}
    if ros == 1:
        (port,) = free_ports(1)
        return RosPlace(
            {"ROS_MASTER_URI": f"http://{HOST}:{port}", "ROS_HOSTNAME": HOST, "ROS_IP": HOST, **home}, port
        )
    # Distributions up to Humble know the second, those from Iron on the first.
    alone = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOCALHOST_ONLY": "1"}
    return RosPlace({"ROS_DOMAIN_ID": str(_free_domain()), **alone, **home})


def _free_domain() -> int:
    candidates = random.sample(DOMAINS, len(DOMAINS))
    return next((number for number in candidates if not _taken(number)), candidates[0])


def _taken(domain: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", _FIRST_PORT + _DOMAIN_PORTS * domain + _UNICAST))
        except OSError:
            return True
    return False


def check_ros(name: str, folders: Sequence[str], source: str) -> None:
    """Refuse to start without ROS's Python packages.

    Raises:
        ConfigError: says where they were looked for.
    """
    if importlib.machinery.PathFinder.find_spec(name, [*sys.path, *folders]) is None:
        places = ", ".join(folders)
        raise ConfigError(
            f"{source}: {name} is not installed, neither here nor in {places}; "
            "install ROS, or pass --ros-path DIR"
        )
