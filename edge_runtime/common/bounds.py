"""Bounds on what files may say: finite numbers can be absurd, and would become infinite on the way."""

from collections.abc import Mapping
from typing import Annotated, Final

import msgspec

GREATEST: Final = 1e6
"""Of any length, speed, weight or factor, in SI units: far beyond every robot, far from overflow."""
GREATEST_SPEED_M_S: Final = 1e3
"""Of any robot that tells its motion."""
GREATEST_YAW_RATE_RAD_S: Final = 20.0
"""Of any robot that is told to turn."""
Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
"""A number of a message from another machine, times since 1970 included: neither infinite nor NaN."""
RATE_HZ: Final = (1.0, 1000.0)
"""Least and greatest control rate."""
MOST_ROBOTS: Final = 256
"""Of a team."""
MOST_OBJECTIVES: Final = 32
"""In force at once; as many as the compiled kernel takes."""


def is_motion(position_m: tuple[float, ...], velocity_m_s: tuple[float, ...]) -> bool:
    """Whether position and velocity, of as many components, can be a robot's.

    They are finite, within `GREATEST` and `GREATEST_SPEED_M_S`.
    """
    if len(position_m) != len(velocity_m_s):
        return False
    for place, speed in zip(position_m, velocity_m_s, strict=True):
        if not (abs(place) <= GREATEST and abs(speed) <= GREATEST_SPEED_M_S):
            return False
    return True


def check_bounds(record: msgspec.Struct, bounds: Mapping[str, tuple[float, float]]) -> None:
    """Check that fields of a record lie within bounds, component by component; what is no number passes.

    Raises:
        ValueError: names the field and its bounds.
    """
    for field, (low, high) in bounds.items():
        value = getattr(record, field)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, int | float) and not low <= number <= high:
                raise ValueError(f"`{field}` must lie in [{low:g}, {high:g}], got {number:g}")
