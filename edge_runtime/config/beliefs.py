"""What a fleet file says that each robot believes: the tables ``[[belief]]``, and the code that they name."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from edge_runtime.common.own_code import own_class, own_faults
from edge_runtime.common.toml_file import Table, refuse
from edge_runtime.observation.belief import Belief, Beliefs


class BeliefSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A place that each robot works out for itself, tick by tick."""

    name: str
    """By which objectives and recordings call it, as a tracked object."""
    code: str
    """Its class, as ``module:Class``; it lies beside the fleet file, or is installed."""
    parameters: Table = {}
    """Keyword arguments of the class."""


def check_beliefs(path: Path, beliefs: Sequence[BeliefSettings], taken: Sequence[str]) -> None:
    """Refuse names that are in use.

    Raises:
        ConfigError: names the file and the key.
    """
    names = [*taken, *(each.name for each in beliefs)]
    for index, each in enumerate(beliefs):
        if names.index(each.name) < len(taken) + index:
            refuse(path, f"belief[{index}].name", f"{each.name!r} is taken already")


def make_beliefs(path: Path, beliefs: Sequence[BeliefSettings]) -> Beliefs:
    """Make one robot's, with nothing seen yet; this executes their code.

    Raises:
        ConfigError: if a class cannot be imported, is none of a belief, or cannot be made of its parameters.
    """
    made = {}
    for index, each in enumerate(beliefs):
        key = f"{path}: belief[{index}].code"
        kind = own_class(each.code, path.parent, key, Belief, "follow(team)")
        with own_faults(key, f"{each.code!r} cannot be made"):
            made[each.name] = kind(**each.parameters)
    return Beliefs(made)
