"""Bounds on what files may say: finite numbers can be absurd, and would become infinite on the way."""

from collections.abc import Mapping
from typing import Final

import msgspec

GREATEST: Final = 1e6
"""Of any length, speed, weight or factor, in SI units: far beyond every robot, far from overflow."""


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
