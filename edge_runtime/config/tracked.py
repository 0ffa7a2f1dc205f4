"""What a fleet file says of things that are no robots, yet have a pose: the tables ``[[tracked]]``."""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.bounds import GREATEST, MOST_ROBOTS, check_bounds
from edge_runtime.common.toml_file import refuse
from edge_runtime.config.network import CarrierSettings, Endpoint, stream_place
from edge_runtime.messages import Vector2

LONGEST_NAME: Final = 60
"""Characters."""


class Tracked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A payload, a person, a door: sources and objectives know it by its name."""

    name: str
    """By which manifests, objectives and recordings call it."""
    pose: str | None = None
    """The address of its pose stream, such as edge-pose's ``10.0.0.5:47100``; the simulation's where None."""
    goal_m: Vector2 | None = None
    """Where it is to go; None for what goes where it likes."""
    start_m: Vector2 = (0.0, 0.0)
    """Where a simulated one starts."""
    radius_m: float = 0.05
    """Of the disc by which reports draw it."""
    rigid_body: int | None = None
    """Its streaming id in the motion-capture system."""

    def __post_init__(self) -> None:
        if not (self.name.strip() and self.name.isprintable() and len(self.name) <= LONGEST_NAME):
            raise ValueError(f"`name` must be 1 to {LONGEST_NAME} printable characters, got {self.name!r}")
        getattr(self, "pose_place")  # noqa: B009  # it raises
        check_bounds(self, dict.fromkeys(("goal_m", "start_m"), (-GREATEST, GREATEST)))
        check_bounds(self, {"radius_m": (1.0 / GREATEST, GREATEST)})

    @property
    def pose_place(self) -> Endpoint | None:
        """Where its pose stream comes from; None if the simulation moves it."""
        return None if self.pose is None else stream_place(self.pose, "pose")


def check_tracked(path: Path, carrier: CarrierSettings | None, tracked: Sequence[Tracked]) -> None:
    """Check what no table shows by itself.

    Raises:
        ConfigError: names the file, the key and what is allowed.
    """
    if len(tracked) > MOST_ROBOTS:
        refuse(path, "tracked", f"at most {MOST_ROBOTS} are allowed, got {len(tracked)}")
    names = [each.name for each in tracked]
    tags = list(map(tag_of, names))
    for index, each in enumerate(tracked):
        key = f"tracked[{index}]"
        if each.name in names[:index]:
            refuse(path, f"{key}.name", f"{each.name!r} is taken by tracked[{names.index(each.name)}]")
        if tags[index] in tags[:index]:
            other = names[tags.index(tags[index])]
            refuse(path, f"{key}.name", f"{each.name!r} and {other!r} share a number on the wire; rename one")
        if carrier is None and each.pose is not None:
            refuse(path, f"{key}.pose", 'means nothing without [carrier]; add [carrier] key = "team.key"')
        if carrier is not None and each.pose is None:
            missing = f"missing: with [carrier] nothing else tells where {each.name!r} is"
            refuse(
                path, f"{key}.pose", f"{missing}; allowed: the address of a stream, such as 10.0.0.5:47100"
            )


def tag_of(name: str) -> int:
    """The number, from 1 to 65535, by which streams tell what they are about."""
    return zlib.crc32(name.encode()) % 0xFFFF + 1
