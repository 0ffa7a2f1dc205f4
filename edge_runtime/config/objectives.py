"""The objectives file: TOML, validated once, and the import of the user's own code that it names."""

import os
from collections.abc import Collection
from pathlib import Path

import msgspec

from edge_runtime.common.bounds import MOST_OBJECTIVES
from edge_runtime.common.own_code import own_class, own_faults, own_name
from edge_runtime.common.toml_file import Table, parse_toml, read_toml, refuse, to_record
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.objectives import BUILT_IN, Objective


class _Tables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    objectives: tuple[Table, ...] = ()
    guidance: GuidanceSettings = GuidanceSettings()


def load_objective_set(path: Path) -> ObjectiveSet:
    """Read an objectives file: ``[[objectives]]`` and ``[guidance]``.

    Raises:
        ConfigError: names the file, the key and what is allowed.
    """
    return make_objective_set(read_toml(path), path)


def parse_objective_set(
    content: bytes, path: Path, own: Collection[type[Objective]] | None = None
) -> ObjectiveSet:
    """Read the content of an objectives file; ``path`` is its name, beside which own objectives lie.

    Args:
        content: of the file.
        path: its name.
        own: the only own objectives that it may name; nothing is imported then.

    Raises:
        ConfigError: as `load_objective_set`.
    """
    return make_objective_set(parse_toml(content, path), path, own)


def make_objective_set(
    table: Table, path: Path, own: Collection[type[Objective]] | None = None
) -> ObjectiveSet:
    """Check what an objectives file says; see `parse_objective_set`.

    Raises:
        ConfigError: as `load_objective_set`.
    """
    if not table:  # as when a copy broke off: no limit is dropped in silence
        refuse(path, "objectives", "missing; a file for none says `objectives = []`")
    tables = to_record(table, _Tables, path)
    return ObjectiveSet(make_objectives(tables.objectives, path, own), tables.guidance)


def make_objectives(
    tables: tuple[Table, ...], path: Path, own: Collection[type[Objective]] | None = None
) -> tuple[Objective, ...]:
    """Check the tables ``[[objectives]]`` of a file; see `parse_objective_set`.

    Raises:
        ConfigError: as `load_objective_set`.
    """
    if len(tables) > MOST_OBJECTIVES:
        refuse(path, "objectives", f"at most {MOST_OBJECTIVES} at once, got {len(tables)}")
    return tuple(_objective(table, path, f"objectives[{i}]", own) for i, table in enumerate(tables))


def _objective(table: Table, path: Path, key: str, own: Collection[type[Objective]] | None) -> Objective:
    known: dict[str, type[Objective]] = {str(kind.__struct_config__.tag): kind for kind in BUILT_IN}
    known |= {own_name(kind): kind for kind in own or ()}
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
        kind = own_objective(name, Path(os.path.realpath(path)).parent, f"{path}: {key}.type")
    elif ":" in name:
        refuse(
            path, f"{key}.type", f"{name!r} was not named by the files that the robot started with; {allowed}"
        )
    else:
        refuse(path, f"{key}.type", f"unknown objective {name!r}; {allowed}")
    return _made(kind, {**table, "type": kind.__struct_config__.tag}, path, key)


def _made(kind: type[Objective], table: Table, path: Path, key: str) -> Objective:
    """Make an objective; an own one may get anything wrong that a class can."""
    called = own_name(kind)
    with own_faults(f"{path}: {key}", f"{called!r} cannot be made"):
        objective = to_record(table, kind, path, key)
        name = objective.name
        msgspec.json.encode(objective)  # as its digest, its record and the team's orders do
    if not isinstance(name, str):
        refuse(path, key, f"the name of {called!r} must be a string, got {name!r}")
    return objective


def own_objective(name: str, folder: Path, source: str) -> type[Objective]:
    """Import a user's own objective, on the user's word alone: this executes its module.

    Args:
        name: ``module:Class``.
        folder: where the module may lie, if it is not installed.
        source: what named it, for errors.

    Raises:
        ConfigError: if it cannot be imported, or is no objective.
    """
    return own_class(name, folder, source, Objective, "evaluate(motion, outlook)")
