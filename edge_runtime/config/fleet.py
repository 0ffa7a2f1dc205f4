"""The fleet file and the objectives file: TOML, validated once, every error names its key."""

import importlib
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.common.toml_file import Table, parse_toml, read_toml, refuse, to_record
from edge_runtime.config.network import CarrierSettings, Robot, WatchSettings, check_network
from edge_runtime.config.zenoh import check_zenoh
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import BUILT_IN, Objective
from edge_runtime.policy.manifest import RATE_HZ

OLDEST_STATE_S: Final = 0.1
"""No action ever rests on an own state that is older."""
DEFAULT_FLEET: Final = Path(__file__).parents[1] / "fleets" / "navigation.toml"


class Steering(msgspec.Struct, frozen=True):
    """What steers the team at execution time; an objectives file holds just this."""

    objectives: tuple[Objective, ...] = ()
    guidance: GuidanceSettings = GuidanceSettings()


class Team(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What all robots share."""

    policy: str = "navigation"
    """A packaged policy's name, or the directory of a bundle, relative to the fleet file."""
    rate_hz: float | None = None
    """Control rate; the policy's own where None."""
    goal_tolerance_m: float = 0.1
    max_state_age_s: float = 0.1
    """An own state older than this stops the robot; may be made stricter, never laxer."""
    slew_per_s: float | None = None
    """Greatest change of each action component in a second; unlimited where None."""

    def __post_init__(self) -> None:
        positive = (1.0 / GREATEST, GREATEST)
        check_bounds(self, {"goal_tolerance_m": positive, "slew_per_s": positive, "rate_hz": RATE_HZ})
        check_bounds(self, {"max_state_age_s": (1e-3, OLDEST_STATE_S)})


class Fleet(msgspec.Struct, frozen=True):
    """A fleet file."""

    path: Path
    team: Team
    robots: tuple[Robot, ...]
    steering: Steering
    carrier: CarrierSettings | None = None
    """The team's network; None if all its robots are simulated in one process."""
    watch: WatchSettings | None = None
    """Who watches the team; nobody where None."""

    def robot(self, robot_id: int) -> Robot:
        """Return the robot with this id.

        Raises:
            ConfigError: lists the known ids.
        """
        for robot in self.robots:
            if robot.id == robot_id:
                return robot
        known = ", ".join(str(robot.id) for robot in self.robots)
        raise ConfigError(f"{self.path}: robots: none has id {robot_id} (--robot-id); known ids: {known}")


class _FleetTables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    robots: tuple[Robot, ...]
    team: Team = Team()
    objectives: tuple[Table, ...] = ()
    guidance: GuidanceSettings = GuidanceSettings()
    carrier: CarrierSettings | None = None
    watch: WatchSettings | None = None


class _SteeringTables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    objectives: tuple[Table, ...] = ()
    guidance: GuidanceSettings = GuidanceSettings()


def load_fleet(path: Path) -> Fleet:
    """Read a fleet file: team, robots, objectives, guidance, carrier and watch.

    Raises:
        ConfigError: names the file, the key and what is allowed.
    """
    tables = to_record(read_toml(path), _FleetTables, path)
    if not tables.robots:
        refuse(path, "robots", "a fleet needs at least one robot")
    ids = [robot.id for robot in tables.robots]
    for index, robot_id in enumerate(ids):
        if robot_id in ids[:index]:
            refuse(path, f"robots[{index}].id", f"{robot_id} is taken by robots[{ids.index(robot_id)}]")
    check_network(path, tables.carrier, tables.watch, tables.robots)
    check_zenoh(path, tables.carrier, tables.robots)
    steering = Steering(_objectives(tables.objectives, path), tables.guidance)
    return Fleet(path, tables.team, tables.robots, steering, tables.carrier, tables.watch)


def load_steering(path: Path) -> Steering:
    """Read an objectives file: ``[[objectives]]`` and ``[guidance]``.

    Raises:
        ConfigError: names the file, the key and what is allowed.
    """
    return make_steering(read_toml(path), path)


def parse_steering(content: bytes, path: Path, known: Collection[type[Objective]] | None = None) -> Steering:
    """Read the content of an objectives file; ``path`` is its name, beside which own objectives lie.

    Args:
        content: of the file.
        path: its name.
        known: the only own objectives that it may name; nothing is imported then.

    Raises:
        ConfigError: as `load_steering`.
    """
    return make_steering(parse_toml(content, path), path, known)


def make_steering(table: Table, path: Path, known: Collection[type[Objective]] | None = None) -> Steering:
    """Check what an objectives file says; see `parse_steering`.

    Raises:
        ConfigError: as `load_steering`.
    """
    tables = to_record(table, _SteeringTables, path)
    return Steering(_objectives(tables.objectives, path, known), tables.guidance)


def _objectives(
    tables: tuple[Table, ...], path: Path, own: Collection[type[Objective]] | None = None
) -> tuple[Objective, ...]:
    return tuple(_objective(table, path, f"objectives[{i}]", own) for i, table in enumerate(tables))


def _objective(table: Table, path: Path, key: str, own: Collection[type[Objective]] | None) -> Objective:
    known: dict[str, type[Objective]] = {str(kind.__struct_config__.tag): kind for kind in BUILT_IN}
    known |= {f"{kind.__module__}:{kind.__qualname__}": kind for kind in own or ()}
    allowed = f"allowed: {', '.join(known)}" + (", or an own one as module:Class" if own is None else "")
    name = table.get("type")
    if not isinstance(name, str):
        refuse(
            path,
            f"{key}.type",
            f"{'missing' if name is None else f'must be a string, got {name}'}; {allowed}",
        )
    if name in known:
        kind = known[name]
    elif ":" in name and own is None:
        kind = _import_objective(name, path, f"{key}.type")
    elif ":" in name:
        refuse(
            path, f"{key}.type", f"{name!r} was not named by the files that the robot started with; {allowed}"
        )
    else:
        refuse(path, f"{key}.type", f"unknown objective {name!r}; {allowed}")
    return to_record({**table, "type": kind.__struct_config__.tag}, kind, path, key)


def _import_objective(name: str, path: Path, key: str) -> type[Objective]:
    """Import ``module:Class``; the module may lie beside the file that names it."""
    module_name, _, class_name = name.partition(":")
    beside = str(path.resolve().parent)
    sys.path.insert(0, beside)
    try:
        kind = getattr(importlib.import_module(module_name), class_name)
    except Exception as error:  # a user's module may fail in any way while it is imported
        raise ConfigError(f"{path}: {key}: cannot import {name!r} ({error})") from error
    finally:
        sys.path.remove(beside)
    if not (isinstance(kind, type) and issubclass(kind, Objective)):
        refuse(path, key, f"{name!r} is not a subclass of edge_runtime.objectives.Objective")
    if kind.evaluate is Objective.evaluate:
        refuse(path, key, f"{name!r} must define evaluate(motion, outlook)")
    return kind
