"""Fleet files for one machine: generated, or the user's with every robot's address moved to a free port."""

import secrets
from collections.abc import Sequence
from pathlib import Path

from edge_runtime.common.paths import named_file
from edge_runtime.common.toml_file import Table, read_toml
from edge_runtime.config.fleet import FLEETS
from edge_runtime.messages import Vector2
from edge_runtime.observation import Sensor
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.policy.bundle_source import is_remote
from firmware_bridge.sil.scenario.layout import places
from firmware_bridge.sil.scenario.ports import HOST, Network

NEAREST = 3
"""How many neighbours a robot of a generated team listens to."""


def generated_team(robots: int, *, wheels: bool = False) -> Table:
    """Return the table of a fleet file: the packaged policy, inside a speed limit and a safety margin.

    Args:
        robots: how many.
        wheels: whether they are Huskies, as the packaged fleet has them, and not the policy's own discs.
    """
    table = read_toml(FLEETS / "husky.toml") if wheels else _discs()
    scale_m = table["team"].get("scale_m", 1.0)
    return {
        **table,
        "carrier": {"type": "udp", "key": "team.key", "nearest": NEAREST},
        "robots": [
            {"id": index, "start_m": _scaled(start_m, scale_m), "goal_m": _scaled(goal_m, scale_m)}
            for index, (start_m, goal_m) in enumerate(places(robots))
        ],
    }


def _scaled(place_m: Vector2, scale_m: float) -> list[float]:
    return [scale_m * value for value in place_m]


def _discs() -> Table:
    return {
        "team": {"policy": "navigation"},
        "objectives": [
            {"type": "speed_limit", "limit_m_s": 0.3},
            {"type": "safety_margin", "distance_m": 0.25},
        ],
        "guidance": {"mode": "terminal", "scale": 10.0},
    }


def task_team(task: str) -> Table:
    """Return the table of a packaged task's fleet file, as a team of processes on one network."""
    table = read_toml(FLEETS / f"{task}.toml")
    return {**table, "carrier": {"type": "udp", "key": "team.key"}}


def with_ranges(table: Table, stream: int) -> Table:
    """Return the fleet whose robots hear from the world what their range sensors read, at this port."""
    return {**table, "robots": [{**robot, "ranges": f"{HOST}:{stream}"} for robot in table["robots"]]}


def with_streams(table: Table, stream: int, *, wanted: bool = False) -> Table:
    """Return the fleet with poses, tracked objects and sensors told by the world, at this port.

    That is where it moves more than robots, or where it is wanted; else the table as it is.
    """
    if table.get("simulation", {}).get("plant", "discs") == "discs" and not wanted:
        return table
    place, sensors = f"{HOST}:{stream}", sensor_names(table)
    robots = [{**robot, "pose": place, "sensors": dict.fromkeys(sensors, place)} for robot in table["robots"]]
    tracked = [{**each, "pose": place} for each in table.get("tracked", ())]
    return {**table, "robots": robots, **({"tracked": tracked} if tracked else {})}


def sensor_names(table: Table) -> list[str]:
    """Names of the sensors by which the team's packaged policy observes."""
    policy = table.get("team", {}).get("policy", "navigation")
    fields = packaged_bundle(policy).manifest.observation if "/" not in policy else ()
    return [field.sensor for field in fields if isinstance(field, Sensor)]


def write_key(path: Path) -> None:
    """Create the key of a generated team, readable by nobody else."""
    path.touch(mode=0o600)
    path.write_text(secrets.token_hex(32))


def on_zenoh(table: Table) -> bool:
    """Whether a fleet's frames travel over Zenoh."""
    return bool(table["carrier"].get("type") == "zenoh")


def on_network(table: Table, robot_id: int, network: Network) -> Table:
    """Return the fleet as one robot is to see it: itself at its ports, the others there or at their relays'.

    A router is left out: robots on one machine reach each other.
    """
    addresses = {**network.ports, **network.relays, robot_id: network.ports[robot_id]}
    moved = {other: {"address": f"{HOST}:{port}"} for other, port in addresses.items()}
    for other, port in network.zenoh.items():
        moved[other]["zenoh"] = f"{HOST}:{network.tunnels.get((robot_id, other), port)}"
    carrier = {key: value for key, value in table["carrier"].items() if key != "router"}
    robots = [{**robot, **moved[robot["id"]]} for robot in table["robots"]]
    return {**table, "carrier": carrier, "robots": robots}


def resolved(table: Table, folder: Path) -> Table:
    """Return the fleet whose paths, relative to ``folder`` so far, mean the same from anywhere."""
    moved = dict(table)
    if "carrier" in table:
        carrier = dict(table["carrier"])
        for name in ("key", "operator_key"):
            if name in carrier:
                carrier[name] = str(named_file(folder, carrier[name]))
        if "tls" in carrier:
            files = carrier["tls"].items()
            carrier["tls"] = {name: str(named_file(folder, file)) for name, file in files}
        moved["carrier"] = carrier
    if "team" in table:
        moved["team"] = _with_policy(table["team"], folder)
    moved["robots"] = [_with_policy(robot, folder) for robot in table["robots"]]
    return moved


def _with_policy(table: Table, folder: Path) -> Table:
    policy = table.get("policy", "")
    elsewhere = "/" in policy and not is_remote(policy)
    return {**table, "policy": str(folder / policy)} if elsewhere else table


def write_fleets(table: Table, robots: Sequence[int], network: Network, folder: Path) -> dict[int, Path]:
    """Write each robot's fleet file."""
    import tomli_w  # noqa: PLC0415 - of the extra `sil`; the command says so where it is missing

    files = {}
    for robot_id in robots:
        files[robot_id] = folder / f"fleet_{robot_id}.toml"
        files[robot_id].write_text(tomli_w.dumps(on_network(table, robot_id, network)))
    return files
