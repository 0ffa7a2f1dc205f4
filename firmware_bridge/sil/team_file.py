"""Fleet files for one machine: generated, or the user's with every robot's address moved to a free port."""

import secrets
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path

from edge_runtime.toml_file import Table
from firmware_bridge.sil.layout import places

HOST = "127.0.0.1"
NEAREST = 3
"""How many neighbours a robot of a generated team listens to."""


def generated_team(robots: int) -> Table:
    """Return the table of a fleet file: the packaged policy, inside a speed limit and a safety margin."""
    return {
        "team": {"policy": "navigation"},
        "carrier": {"type": "udp", "key": "team.key", "nearest": NEAREST},
        "robots": [
            {"id": index, "start_m": list(place.start_m), "goal_m": list(place.goal_m)}
            for index, place in enumerate(places(robots))
        ],
        "objectives": [
            {"type": "speed_limit", "limit_m_s": 0.3},
            {"type": "safety_margin", "distance_m": 0.25},
        ],
        "guidance": {"mode": "terminal", "scale": 10.0},
    }


def write_key(path: Path) -> None:
    """Create the key of a generated team, readable by nobody else."""
    path.touch(mode=0o600)
    path.write_text(secrets.token_hex(32))


def free_ports(count: int) -> tuple[int, ...]:
    """Return UDP ports of this machine that nobody holds now; all differ."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    try:
        for one in sockets:
            one.bind((HOST, 0))
        return tuple(one.getsockname()[1] for one in sockets)
    finally:
        for one in sockets:
            one.close()


def with_ports(table: Table, ports: Mapping[int, int]) -> Table:
    """Return the fleet in which each robot listens on its port of this machine."""
    robots = [{**robot, "address": f"{HOST}:{ports[robot['id']]}"} for robot in table["robots"]]
    return {**table, "robots": robots}


def resolved(table: Table, folder: Path) -> Table:
    """Return the fleet whose paths, relative to ``folder`` so far, mean the same from anywhere."""
    moved = dict(table)
    if "carrier" in table:
        carrier = dict(table["carrier"])
        for name in ("key", "operator_key"):
            if name in carrier:
                carrier[name] = str(folder / Path(carrier[name]).expanduser())
        moved["carrier"] = carrier
    if "team" in table:
        moved["team"] = _with_policy(table["team"], folder)
    moved["robots"] = [_with_policy(robot, folder) for robot in table["robots"]]
    return moved


def _with_policy(table: Table, folder: Path) -> Table:
    policy = table.get("policy", "")
    return {**table, "policy": str(folder / policy)} if "/" in policy else table


def write_fleets(
    table: Table, robots: Sequence[int], ports: Mapping[int, int], relays: Mapping[int, int], folder: Path
) -> dict[int, Path]:
    """Write each robot's fleet file: itself at its port, the others at theirs or at their relay's."""
    import tomli_w  # noqa: PLC0415 - of the extra `sil`; the command says so where it is missing

    files = {}
    for robot_id in robots:
        seen = {other: relays.get(other, port) for other, port in ports.items()} | {robot_id: ports[robot_id]}
        files[robot_id] = folder / f"fleet_{robot_id}.toml"
        files[robot_id].write_text(tomli_w.dumps(with_ports(table, seen)))
    return files
