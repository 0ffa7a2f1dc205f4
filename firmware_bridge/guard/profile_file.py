"""What all profiles of robots have: a file, and a speed limit."""

import math
import os
from pathlib import Path

import msgspec

from edge_runtime.errors import ConfigError


class SpeedLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The most that the robot may be asked for."""

    speed_m_s: float
    """Greatest commanded speed; `--max-speed` may only be lower."""

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_m_s < math.inf:
            raise ValueError(f"`speed_m_s` must be positive, got {self.speed_m_s}")


def profile_file(name: str, shipped: Path, flag: str) -> Path:
    """Return the file of a profile given by name or by path.

    Args:
        name: of the profile, or the path of a .toml file.
        shipped: folder of the profiles that have names.
        flag: which names it.

    Raises:
        ConfigError: if there is no such profile, with the names that there are.
    """
    path = Path(name) if name.endswith(".toml") else shipped / f"{name}.toml"
    if not os.path.isfile(path):  # noqa: PTH113  # pathlib's raises for names that are too long
        known = ", ".join(sorted(file.stem for file in shipped.glob("*.toml")))
        raise ConfigError(f"{flag} {name}: no such profile; known: {known}, or the path of a .toml file")
    return path
