"""Do two forms of a policy compute the same? One measure, at export and on the robot."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

TOLERANCE: Final = 1e-5
"""Largest difference that single precision accounts for; see `largest_difference`."""


def largest_difference(found: npt.NDArray[Any], expected: npt.NDArray[Any]) -> float:
    """Return the largest difference, absolute below and relative above a magnitude of one.

    The magnitude is an element's own or its component's root mean square over the inputs, whichever is
    greater: single precision rounds what large terms leave when they cancel as it rounds the terms.

    Args:
        found: (R, B, d) velocities and derivatives at B inputs.
        expected: (R, B, d) likewise.

    Returns:
        NaN if either holds one.
    """
    size = np.sqrt(np.mean(np.square(expected), axis=1, keepdims=True))
    magnitude = np.maximum(np.maximum(1.0, size), np.abs(expected))
    return float(np.max(np.abs(found - expected) / magnitude))
