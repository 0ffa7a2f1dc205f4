"""``manifest.json``, of this format and of those before it: whatever it was, a `Manifest` comes of it."""

from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import asdict

from edge_runtime.common.regular_file import BYTE_ORDER_MARK
from edge_runtime.common.toml_file import refuse, to_record
from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import (
    GoalOffset,
    ObservationField,
    Position,
    Proximity,
    Ranges,
    Sensor,
    Velocity,
)
from edge_runtime.policy.manifest import BUNDLE_FORMAT, Manifest

FIRST_FORMAT: Final = "cfpg-bundle/1"
FIRST_SOURCES: Final[dict[str, type[Position | Velocity | GoalOffset | Proximity | Ranges]]] = {
    "position": Position,
    "velocity": Velocity,
    "goal_offset": GoalOffset,
    "proximity": Proximity,
    "ranges": Ranges,
}


class _FirstField(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An observation field of format 1: its name said where it came from."""

    name: str
    size: int
    unit: str

    def with_source(self) -> ObservationField:
        """The field with its source; what only a simulation knew is now a sensor of that name."""
        kind = FIRST_SOURCES.get(self.name)
        stated = (self.name, self.size, self.unit)
        return Sensor(*stated, sensor=self.name) if kind is None else kind(*stated)


class _FirstDynamics(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The one motion model of format 1."""

    mass_kg: float
    drag: float
    dt_s: float
    substeps: int = 1


class _First(msgspec.Struct, frozen=True):
    """What format 1 said in other words; the rest of its keys are those of format 2."""

    observation: tuple[_FirstField, ...]
    dynamics: _FirstDynamics


def read_manifest(encoded: bytes, path: Path) -> Manifest:
    """Decode a manifest; `edge_runtime.policy.schema.check_manifest` has yet to check it.

    Args:
        encoded: the file's content.
        path: the file, to name in errors.

    Raises:
        BundleError: names the key that is missing, unknown or of the wrong type.
    """
    try:
        table = msgspec.json.decode(encoded.removeprefix(BYTE_ORDER_MARK), type=dict[str, Any])
        if (found := table.get("format")) not in (FIRST_FORMAT, BUNDLE_FORMAT):
            raise BundleError(f"{path}: format is {found!r}, must be {FIRST_FORMAT!r} or {BUNDLE_FORMAT!r}")
        return to_record(_second(table, path) if found == FIRST_FORMAT else table, Manifest, path)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BundleError(f"{path}: {error}") from error
    except ConfigError as error:
        raise BundleError(str(error)) from error


def _second(table: dict[str, Any], path: Path) -> dict[str, Any]:
    """The table of a manifest of format 1 in the words of format 2."""
    first = to_record(table, _First, path)
    if "motion" in table:
        refuse(path, "motion", f"unknown key in {FIRST_FORMAT}; allowed: dynamics")
    rest = {name: value for name, value in table.items() if name not in ("observation", "dynamics", "format")}
    motion = PointForce(**asdict(first.dynamics))
    observation = tuple(field.with_source() for field in first.observation)
    return {**rest, "format": BUNDLE_FORMAT, "observation": observation, "motion": motion}
