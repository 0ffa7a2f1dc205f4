"""Vectors of a few components in Python floats, which is fastest for so few.

Sums are taken in order: Python's own may add up otherwise from one version to the next, and a recorded tick
is to be repeated bit for bit.
"""

from collections.abc import Sequence


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """The inner product of two vectors of one size."""
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def plus(a: Sequence[float], factor: float, b: Sequence[float]) -> tuple[float, ...]:
    """Add ``factor`` times b to a."""
    return tuple([x + factor * y for x, y in zip(a, b, strict=True)])
