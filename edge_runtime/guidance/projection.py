"""How the objectives' descent directions become one guidance vector (paper, section IV-C).

Each projection exists twice with the same result: for one robot in the plane in Python floats, which is
fastest for two numbers, and for B robots of any action size in numpy. Both take

- the descent directions g_m = -grad J_m, pulled back to the flow's action,
- their factors eta lambda_m (projections are homogeneous, so the scale can go in first),
- the nominal velocity v,

and return the guidance to add to v.

Projections:
    none: the weighted sum; every objective pulls as it likes.
    hierarchical: the paper's. Eq. 14 removes from each g_m what opposes another g_n (n ascending, against
        the original g_n; for two objectives the order has no influence), then eq. 15 removes from the sum
        what opposes v. Keeps Proposition 3; keeps Proposition 2 before eq. 15 for M = 2.
    cone: the point of the common descent cone {x : g_m . x >= 0 for all m} nearest to the weighted sum,
        exact. Keeps Proposition 2 for every M.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from edge_runtime.messages import Vector2
from edge_runtime.motion.outlook import Floats

Projection = Literal["none", "hierarchical", "cone"]
PlanarCombine = Callable[[Sequence[Vector2], Sequence[float], Vector2], Vector2]
BatchCombine = Callable[[Floats, Floats, Floats], Floats]

_FEASIBLE = -1e-12
"""Cosine down to which a direction counts as not opposing a gradient: rounding, not descent."""


def weighted_sum(gradients: Sequence[Vector2], factors: Sequence[float], _nominal: Vector2) -> Vector2:
    """Projection ``none`` for one planar robot."""
    x = y = 0.0
    for (gx, gy), factor in zip(gradients, factors, strict=True):
        x += factor * gx
        y += factor * gy
    return x, y


def harmonize(gradients: Sequence[Vector2], factors: Sequence[float]) -> Vector2:
    """Eq. 14 and the weighted sum, for one planar robot."""
    sum_x = sum_y = 0.0
    for m, (x, y) in enumerate(gradients):
        for n, (nx, ny) in enumerate(gradients):
            dot = x * nx + y * ny
            if dot < 0.0 and n != m:
                square = nx * nx + ny * ny
                if square > 0.0:
                    x -= dot / square * nx
                    y -= dot / square * ny
        sum_x += factors[m] * x
        sum_y += factors[m] * y
    return sum_x, sum_y


def project_onto_nominal(guidance: Vector2, nominal: Vector2) -> Vector2:
    """Eq. 15 for one planar robot: remove what opposes the nominal flow."""
    (x, y), (vx, vy) = guidance, nominal
    dot = x * vx + y * vy
    square = vx * vx + vy * vy
    if dot >= 0.0 or square == 0.0:
        return guidance
    return x - dot / square * vx, y - dot / square * vy


def hierarchical(gradients: Sequence[Vector2], factors: Sequence[float], nominal: Vector2) -> Vector2:
    """Projection ``hierarchical`` for one planar robot: eqs. 14 and 15."""
    return project_onto_nominal(harmonize(gradients, factors), nominal)


def cone(gradients: Sequence[Vector2], factors: Sequence[float], nominal: Vector2) -> Vector2:
    """Projection ``cone`` for one planar robot.

    In the plane the nearest point is the sum itself, its projection onto one gradient's normal line, or
    the origin. All lines pass the origin, so among projections the longest is the nearest.
    """
    x, y = weighted_sum(gradients, factors, nominal)
    if _descends(x, y, gradients):
        return x, y
    best, longest = (0.0, 0.0), 0.0
    for gx, gy in gradients:
        dot = x * gx + y * gy
        square = gx * gx + gy * gy
        if dot < 0.0 < square:
            px, py = x - dot / square * gx, y - dot / square * gy
            length = px * px + py * py
            if length > longest and _descends(px, py, gradients):
                best, longest = (px, py), length
    return best


def _descends(x: float, y: float, gradients: Sequence[Vector2]) -> bool:
    length = math.hypot(x, y)
    return all(x * gx + y * gy >= _FEASIBLE * length * math.hypot(gx, gy) for gx, gy in gradients)


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
            better = (cosine >= _FEASIBLE * length) & (distance < nearest)
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


PLANAR: dict[Projection, PlanarCombine] = {
    "none": weighted_sum,
    "hierarchical": hierarchical,
    "cone": cone,
}
BATCH: dict[Projection, BatchCombine] = {
    "none": weighted_sum_batch,
    "hierarchical": hierarchical_batch,
    "cone": cone_batch,
}
