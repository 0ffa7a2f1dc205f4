"""How the objectives' descent directions become one guidance vector (paper, section IV-C).

For one robot in the plane, in Python floats, which is fastest for two numbers. All take

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

import math
from collections.abc import Callable, Sequence
from typing import Literal

from edge_runtime.messages import Vector2

Projection = Literal["none", "hierarchical", "cone"]
PlanarCombine = Callable[[Sequence[Vector2], Sequence[float], Vector2], Vector2]

FEASIBLE = -1e-12
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
            if n != m and (dot := x * nx + y * ny) < 0.0:
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
    return all(x * gx + y * gy >= FEASIBLE * length * math.hypot(gx, gy) for gx, gy in gradients)


PLANAR: dict[Projection, PlanarCombine] = {
    "none": weighted_sum,
    "hierarchical": hierarchical,
    "cone": cone,
}
