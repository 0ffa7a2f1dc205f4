"""`edge_runtime.guidance.projection` for B robots of any action size."""

import itertools
from collections.abc import Callable

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.projection import FEASIBLE, Projection

BatchCombine = Callable[[Floats, Floats, Floats], Floats]
"""Directions (M, B, d), factors (M,), nominal (B, d) -> guidance (B, d)."""


def weighted_sum_batch(gradients: Floats, factors: Floats, _nominal: Floats) -> Floats:
    """Projection ``none``: gradients (M, B, d), factors (M,), nominal (B, d) -> (B, d)."""
    return np.einsum("m,mbd->bd", factors, gradients)


def harmonize_batch(gradients: Floats, factors: Floats) -> Floats:
    """Eq. 14 and the weighted sum: (M, B, d), (M,) -> (B, d)."""
    squares = np.square(gradients).sum(-1)
    total = np.zeros_like(gradients[0])
    for m, direction in enumerate(gradients):
        kept = direction
        for n, other in enumerate(gradients):
            if n != m:
                kept = kept - _opposing(kept, other, squares[n])[:, None] * other
        total += factors[m] * kept
    return total


def project_onto_nominal_batch(guidance: Floats, nominal: Floats) -> Floats:
    """Eq. 15: (B, d), (B, d) -> (B, d)."""
    return guidance - _opposing(guidance, nominal, np.square(nominal).sum(-1))[:, None] * nominal


def _opposing(vector: Floats, other: Floats, square: Floats) -> Floats:
    """Coefficient (B,) along ``other`` of the part of ``vector`` that opposes it; never positive."""
    dot = np.minimum((vector * other).sum(-1), 0.0)
    return np.divide(dot, square, out=np.zeros_like(dot), where=square > 0.0)


def hierarchical_batch(gradients: Floats, factors: Floats, nominal: Floats) -> Floats:
    """Projection ``hierarchical``: (M, B, d), (M,), (B, d) -> (B, d)."""
    return project_onto_nominal_batch(harmonize_batch(gradients, factors), nominal)


def cone_batch(gradients: Floats, factors: Floats, nominal: Floats) -> Floats:
    """Projection ``cone``: (M, B, d), (M,), (B, d) -> (B, d).

    The nearest point of a polyhedral cone lies on the face where some set of constraints is tight. All
    sets of up to min(M, d) constraints are tried; among the feasible candidates the nearest wins.
    """
    count, _, d = gradients.shape
    target = weighted_sum_batch(gradients, factors, nominal)
    unit = _normalized(gradients)
    best, nearest = np.zeros_like(target), np.square(target).sum(-1)
    for size in range(min(count, d) + 1):
        for tight in itertools.combinations(range(count), size):
            point = _project_off(target, unit[list(tight)])
            length = np.linalg.norm(point, axis=-1)
            cosine = np.einsum("mbd,bd->mb", unit, point).min(0, initial=0.0)
            distance = np.square(point - target).sum(-1)
            better = (cosine >= FEASIBLE * length) & (distance < nearest)
            best[better], nearest[better] = point[better], distance[better]
    return best


def _normalized(gradients: Floats) -> Floats:
    length = np.linalg.norm(gradients, axis=-1, keepdims=True)
    return np.divide(gradients, length, out=np.zeros_like(gradients), where=length > 0.0)


def _project_off(target: Floats, directions: Floats) -> Floats:
    """Project (B, d) onto the orthogonal complement of the directions (S, B, d)."""
    if len(directions) == 0:
        return target.copy()
    rows = directions.transpose(1, 0, 2)
    along = np.linalg.pinv(rows) @ (rows @ target[..., None])
    return target - along[..., 0]


BATCH: dict[Projection, BatchCombine] = {
    "none": weighted_sum_batch,
    "hierarchical": hierarchical_batch,
    "cone": cone_batch,
}
