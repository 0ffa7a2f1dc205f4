"""Vectors of a few components in Python floats, which is fastest for so few.

Sums are taken in order: Python's own may add up otherwise from one version to the next, and a recorded tick
is to be repeated bit for bit. Two components, the plane's, are written out: loops take three times as long.
"""

from collections.abc import Sequence


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """The inner product of two vectors of one size."""
    if len(a) == 2:
        return a[0] * b[0] + a[1] * b[1]
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def through(rows: Sequence[Sequence[float]], vector: Sequence[float]) -> tuple[float, ...]:
    """The inner product of each row with a vector."""
    if len(rows) == len(vector) == 2:
        (xx, xy), (yx, yy), (x, y) = *rows, vector
        return (xx * x + xy * y, yx * x + yy * y)
    return tuple([dot(row, vector) for row in rows])


def plus(a: Sequence[float], factor: float, b: Sequence[float]) -> tuple[float, ...]:
    """Add ``factor`` times b to a."""
    if len(a) == 2:
        return (a[0] + factor * b[0], a[1] + factor * b[1])
    return tuple([x + factor * y for x, y in zip(a, b, strict=True)])
