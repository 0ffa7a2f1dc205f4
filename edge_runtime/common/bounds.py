"""Bounds on what files may say: finite numbers can be absurd, and would become infinite on the way."""

from collections.abc import Mapping
from typing import Annotated, Final

import msgspec

GREATEST: Final = 1e6
"""Of any length, speed, weight or factor, in SI units: far beyond every robot, far from overflow."""
GREATEST_SPEED_M_S: Final = 1e3
"""Of any robot that tells its motion."""
Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
"""A number of a message from another machine, times since 1970 included: neither infinite nor NaN."""
RATE_HZ: Final = (1.0, 1000.0)
"""Least and greatest control rate."""
MOST_ROBOTS: Final = 256
"""Of a team."""
MOST_OBJECTIVES: Final = 32
"""In force at once; as many as the compiled kernel takes."""


def is_motion(x_m: float, y_m: float, v_x_m_s: float, v_y_m_s: float) -> bool:
    """Whether position and velocity can be a robot's: finite, within `GREATEST` and `GREATEST_SPEED_M_S`."""
    within = abs(x_m) <= GREATEST and abs(y_m) <= GREATEST
    return within and abs(v_x_m_s) <= GREATEST_SPEED_M_S and abs(v_y_m_s) <= GREATEST_SPEED_M_S


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
