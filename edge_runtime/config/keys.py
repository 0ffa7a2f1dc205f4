"""The keys that a fleet file names."""

from pathlib import Path

from edge_runtime.common.key_file import read_key
from edge_runtime.common.paths import named_file
from edge_runtime.common.toml_file import refuse
from edge_runtime.config.fleet import Fleet
from edge_runtime.config.network import CarrierSettings
from edge_runtime.errors import ConfigError


def team_key(fleet: Fleet, file: Path | None = None) -> bytes:
    """Read the key of a fleet's robots, from another file than the one it names if there is one.

    Raises:
        ConfigError: if the fleet has none, or it cannot be used.
    """
    return read_key(file) if file else _named(fleet, "key", _carrier(fleet).key)


def operator_key(fleet: Fleet, file: Path | None = None) -> bytes:
    """Read the key of those who may order, as `team_key`; that is the team's where none is named."""
    own = _carrier(fleet).operator_key
    return read_key(file) if file else _named(fleet, "operator_key", own) if own else team_key(fleet)


def _carrier(fleet: Fleet) -> CarrierSettings:
    if fleet.carrier is None:
        refuse(fleet.path, "carrier", "missing: these robots are simulated in one process, which has no key")
    return fleet.carrier


def _named(fleet: Fleet, name: str, file: str) -> bytes:
    try:
        return read_key(named_file(fleet.path.parent, file))
    except ConfigError as error:
        refuse(fleet.path, f"carrier.{name}", str(error))
