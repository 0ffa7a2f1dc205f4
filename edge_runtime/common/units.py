"""Units that the names of numbers end in."""

from typing import Final

UNITS: Final = {"_m_s": "m/s", "_m": "m", "_rad": "rad", "_s": "s", "_hz": "Hz", "_kg": "kg"}


def unit_of(name: str) -> str:
    """Return the unit that a key's name ends in; empty where it names none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")
