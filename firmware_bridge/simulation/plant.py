"""The team's plant: discs that the manifest's dynamics move and that push each other apart on contact.

Obstacles push the robots alike, and are not pushed themselves: they stand, or walk straight on.

Per substep, with gap = |p_i - p_j| - 2 r <= 0, the force on i along (p_i - p_j) / |p_i - p_j| is the
stiffness times the soft penetration w log(1 + exp(-gap / w)); drag acts once per step. This is the
contact model of VMAS 1.5.2 with its default numbers, so that a policy meets the world it was trained in.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.config.fleet import Obstacle
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.motion.range_sensor import Disc

STIFFNESS_N_M = 100.0
CONTACT_WIDTH_M = 1e-3
"""w above: how softly the contact force sets in."""
LEAST_DISTANCE_M = 1e-6
"""Centres nearer than this have no direction to part in, and feel no force."""


class Plant:
    """N discs at rest; leading axes, if any, are independent teams.

    Args:
        dynamics: one control period.
        radius_m: of every disc.
        position_m: (..., N, 2) where they start.
        obstacles: M more discs beside them, in every team the same.
        scale_m: one of the dynamics' metres, in those of positions: contacts are as soft as there.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        radius_m: float,
        position_m: npt.ArrayLike,
        obstacles: Sequence[Obstacle] = (),
        scale_m: float = 1.0,
    ) -> None:
        self.dynamics = dynamics
        self._scale_m = scale_m
        self.radius_m = radius_m
        self.position_m = np.array(position_m, np.float64)
        self.velocity_m_s = np.zeros_like(self.position_m)
        self.obstacle_m = np.array([obstacle.centre_m for obstacle in obstacles]).reshape(-1, 2)
        """(M, 2) where the obstacles are now."""
        self.touched: set[tuple[int, ...]] = set()
        """(..., i, j) of the discs that have touched so far, robots first, then obstacles; j is a robot, or
        an obstacle that i ran into."""
        self._walk_m_s = np.array([obstacle.velocity_m_s for obstacle in obstacles]).reshape(-1, 2)
        robots = [radius_m] * self.position_m.shape[-2]
        self._radii = np.array([*robots, *(obstacle.radius_m for obstacle in obstacles)])

    def step(self, force_n: npt.ArrayLike) -> None:
        """Advance one control period under constant forces (..., N, 2)."""
        force = np.asarray(force_n, np.float64)
        period = self.dynamics.dt_s / self.dynamics.substeps
        self.velocity_m_s *= 1.0 - self.dynamics.drag
        for _ in range(self.dynamics.substeps):
            push = self._contact()
            self.velocity_m_s += (force + push) / self.dynamics.mass_kg * period
            self.position_m += self.velocity_m_s * period
            self.obstacle_m += self._walk_m_s * period

    def obstacles(self) -> list[Disc]:
        """The obstacles as they are now."""
        radii = self._radii[self.position_m.shape[-2] :].tolist()
        return [(x, y, radius) for (x, y), radius in zip(self.obstacle_m.tolist(), radii, strict=True)]

    def _contact(self) -> Floats:
        """Contact forces on the robots (..., N, 2); keeps account of who touched."""
        count = self.position_m.shape[-2]
        teams = self.position_m.shape[:-2]
        obstacles = np.broadcast_to(self.obstacle_m, (*teams, *self.obstacle_m.shape))
        discs = np.concatenate([self.position_m, obstacles], -2) / self._scale_m
        stiff, apart = _stiff_and_apart(discs, self._radii / self._scale_m)
        if stiff.any():
            self.touched.update(map(tuple, np.argwhere(np.triu(stiff)[..., :count, :]).tolist()))
        force: Floats = (stiff[..., None] * apart).sum(-2)[..., :count, :]
        return force


def contact_forces(position_m: Floats, radius_m: float | Floats, scale_m: float = 1.0) -> Floats:
    """Contact force on each of N discs: (..., N, 2) in m -> (..., N, 2) in N; radii may differ: (N,).

    Positions and radii are in a world where one of the dynamics' metres is ``scale_m``.
    """
    stiff, apart = _stiff_and_apart(position_m / scale_m, radius_m / scale_m)
    force: Floats = (stiff[..., None] * apart).sum(-2)
    return force


def _stiff_and_apart(position_m: Floats, radius_m: float | Floats) -> tuple[Floats, Floats]:
    """Force per distance (..., N, N) in N/m, zero without contact, and p_i - p_j (..., N, N, 2)."""
    apart = position_m[..., :, None, :] - position_m[..., None, :, :]
    distance = np.sqrt(np.square(apart).sum(-1))
    radii = np.broadcast_to(np.asarray(radius_m, np.float64), position_m.shape[-2:-1])
    gap = distance - (radii[:, None] + radii[None, :])
    touching = (gap <= 0.0) & (distance >= LEAST_DISTANCE_M)
    penetration = CONTACT_WIDTH_M * np.logaddexp(0.0, np.where(touching, -gap, 0.0) / CONTACT_WIDTH_M)
    stiff = np.where(touching, STIFFNESS_N_M * penetration / np.maximum(distance, LEAST_DISTANCE_M), 0.0)
    return stiff, apart
