"""Vectors of a few components in Python floats, which is fastest for so few.

Sums are taken in order: Python's own may add up otherwise from one version to the next, and a recorded tick
is to be repeated bit for bit. Two components, the plane's, are written out: loops take three times as long.
"""

from collections.abc import Sequence
from typing import Final

new_tuple: Final = tuple.__new__
"""Past the constructor of named tuples, which takes longer than most of what is computed for one."""


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """The inner product of two vectors of one size."""
    if len(a) == 2:
        return a[0] * b[0] + a[1] * b[1]
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def descent(gradient: Sequence[float], left: float, tangents: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """-(I + left V)^T gradient, of a Jacobian V whose columns are the tangents."""
    if len(gradient) == 2:
        (xx, xy), (yx, yy), (x, y) = *tangents, gradient
        return (-x - left * (xx * x + xy * y), -y - left * (yx * x + yy * y))
    return tuple([-g - left * dot(row, gradient) for g, row in zip(gradient, tangents, strict=True)])


def plus(a: Sequence[float], factor: float, b: Sequence[float]) -> tuple[float, ...]:
    """Add ``factor`` times b to a."""
    if len(a) == 2:
        return (a[0] + factor * b[0], a[1] + factor * b[1])
    return tuple([x + factor * y for x, y in zip(a, b, strict=True)])
