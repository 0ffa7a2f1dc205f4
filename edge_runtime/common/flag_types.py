"""What the flags of all commands are read as; what is wrong with one is said as argparse says it."""

import argparse
import ipaddress
import math
from collections.abc import Callable


def number(low: float, high: float) -> Callable[[str], float]:
    """Return what reads a number within bounds."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be a number in [{low:g}, {high:g}], got {text!r}")
        return value

    return convert


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return what reads a whole number within bounds."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number in [{low}, {high}], got {text!r}")
        return value

    return convert


def ipv4(text: str) -> str:
    """Read the address of one machine."""
    try:
        return str(ipaddress.IPv4Address(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be an IPv4 address, got {text!r}") from None
