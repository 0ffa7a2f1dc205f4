"""How the objectives' descent directions become one guidance vector (paper, section IV-C).

For one robot, in Python floats, which is fastest for a few numbers. All take

- the descent directions g_m = -grad J_m, pulled back to the flow's action, (d,) each,
- their factors eta lambda_m (projections are homogeneous, so the scale can go in first),
- the nominal velocity v (d,),

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

import numpy as np

from edge_runtime.common.vectors import dot, plus
from edge_runtime.messages import Vector

Projection = Literal["none", "hierarchical", "cone"]
Combine = Callable[[Sequence[Vector], Sequence[float], Vector], Vector]

FEASIBLE = -1e-12
"""Cosine down to which a direction counts as not opposing a gradient: rounding, not descent."""


def weighted_sum(gradients: Sequence[Vector], factors: Sequence[float]) -> Vector:
    """The sum, of at least one direction."""
    if len(gradients[0]) == 2:
        x = y = 0.0
        for m, (gx, gy) in enumerate(gradients):
            x += factors[m] * gx
            y += factors[m] * gy
        return (x, y)
    total: Vector = (0.0,) * len(gradients[0])
    for gradient, factor in zip(gradients, factors, strict=True):
        total = plus(total, factor, gradient)
    return total


def harmonize(gradients: Sequence[Vector], factors: Sequence[float]) -> Vector:
    """Eq. 14 and the weighted sum, of at least one direction."""
    if len(gradients[0]) == 2:
        return _harmonize_in_the_plane(gradients, factors)
    total: Vector = (0.0,) * len(gradients[0])
    for m, kept in enumerate(gradients):
        for n, other in enumerate(gradients):
            if n != m and (opposing := dot(kept, other)) < 0.0:
                square = dot(other, other)
                if square > 0.0:
                    kept = plus(kept, -opposing / square, other)
        total = plus(total, factors[m], kept)
    return total


def _harmonize_in_the_plane(gradients: Sequence[Vector], factors: Sequence[float]) -> Vector:
    """The same, written out: it runs in every step of a robot that is guided in Python."""
    sum_x = sum_y = 0.0
    for m, (x, y) in enumerate(gradients):
        for n, (other_x, other_y) in enumerate(gradients):
            if n != m and (opposing := x * other_x + y * other_y) < 0.0:
                square = other_x * other_x + other_y * other_y
                if square > 0.0:
                    x += -opposing / square * other_x
                    y += -opposing / square * other_y
        sum_x += factors[m] * x
        sum_y += factors[m] * y
    return (sum_x, sum_y)


def project_onto_nominal(guidance: Vector, nominal: Vector) -> Vector:
    """Eq. 15: remove what opposes the nominal flow."""
    opposing, square = dot(guidance, nominal), dot(nominal, nominal)
    if opposing >= 0.0 or square == 0.0:
        return guidance
    return plus(guidance, -opposing / square, nominal)


def none(gradients: Sequence[Vector], factors: Sequence[float], _nominal: Vector) -> Vector:
    """Projection ``none``."""
    return weighted_sum(gradients, factors)


def hierarchical(gradients: Sequence[Vector], factors: Sequence[float], nominal: Vector) -> Vector:
    """Projection ``hierarchical``: eqs. 14 and 15."""
    return project_onto_nominal(harmonize(gradients, factors), nominal)


def cone(gradients: Sequence[Vector], factors: Sequence[float], _nominal: Vector) -> Vector:
    """Projection ``cone``."""
    total = weighted_sum(gradients, factors)
    if _descends(total, gradients):
        return total
    return _nearest_of_the_plane(total, gradients) if len(total) == 2 else _nearest(total, gradients)


def _nearest_of_the_plane(total: Vector, gradients: Sequence[Vector]) -> Vector:
    """The nearest point is the sum's projection onto one gradient's normal line, or the origin.

    All lines pass the origin, so among projections the longest is the nearest.
    """
    best, longest = (0.0, 0.0), 0.0
    for gradient in gradients:
        opposing, square = dot(total, gradient), dot(gradient, gradient)
        if opposing < 0.0 < square:
            x, y = plus(total, -opposing / square, gradient)
            length = x * x + y * y
            if length > longest and _descends((x, y), gradients):
                best, longest = (x, y), length
    return best


def _nearest(total: Vector, gradients: Sequence[Vector]) -> Vector:
    """The nearest point by Moreau: total + sum mu_m g_m with the least length over mu >= 0.

    Lawson and Hanson's active sets (Solving Least Squares Problems, chapter 23): gradients that the point
    opposes join one by one; one that would pull leaves. The sets never repeat, but for rounding.
    """
    rows = np.array([gradient for gradient in gradients if any(gradient)])
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    target, mu = np.array(total), np.zeros(len(rows))
    tight: list[int] = []
    tolerance = FEASIBLE * math.hypot(*total)
    for _ in range(4 * len(rows)):
        point = target + mu @ rows
        slack = rows @ point
        slack[tight] = 0.0
        worst = int(slack.argmin())
        if slack[worst] >= tolerance:
            return tuple(point.tolist())
        tight.append(worst)
        while tight:
            wanted = np.linalg.lstsq(rows[tight].T, -target, rcond=None)[0]
            if (wanted > 0.0).all():
                mu[tight] = wanted
                break
            held = mu[tight]
            shares = np.where(wanted > 0.0, 1.0, held / np.maximum(held - wanted, 1e-300))
            mu[tight] = held + shares.min() * (wanted - held)
            mu[tight[int(shares.argmin())]] = 0.0
            tight = [m for m in tight if mu[m] > 0.0]
    return (0.0,) * len(total)


def _descends(vector: Vector, gradients: Sequence[Vector]) -> bool:
    length = math.hypot(*vector)
    return all(dot(vector, gradient) >= FEASIBLE * length * math.hypot(*gradient) for gradient in gradients)


COMBINE: dict[Projection, Combine] = {
    "none": none,
    "hierarchical": hierarchical,
    "cone": cone,
}
