"""The team's plant: discs that the manifest's dynamics move and that push each other apart on contact.

Per substep, with gap = |p_i - p_j| - 2 r <= 0, the force on i along (p_i - p_j) / |p_i - p_j| is the
stiffness times the soft penetration w log(1 + exp(-gap / w)); drag acts once per step. This is the
contact model of VMAS 1.5.2 with its default numbers, so that a policy meets the world it was trained in.
"""

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.motion.dynamics import Dynamics

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
    """

    def __init__(self, dynamics: Dynamics, radius_m: float, position_m: npt.ArrayLike) -> None:
        self.dynamics = dynamics
        self.radius_m = radius_m
        self.position_m = np.array(position_m, np.float64)
        self.velocity_m_s = np.zeros_like(self.position_m)

    def step(self, force_n: npt.ArrayLike) -> None:
        """Advance one control period under constant forces (..., N, 2)."""
        force = np.asarray(force_n, np.float64)
        period = self.dynamics.dt_s / self.dynamics.substeps
        self.velocity_m_s *= 1.0 - self.dynamics.drag
        for _ in range(self.dynamics.substeps):
            push = contact_forces(self.position_m, self.radius_m)
            self.velocity_m_s += (force + push) / self.dynamics.mass_kg * period
            self.position_m += self.velocity_m_s * period


def contact_forces(position_m: Floats, radius_m: float | Floats) -> Floats:
    """Contact force on each of N discs: (..., N, 2) in m -> (..., N, 2) in N; radii may differ: (N,)."""
    apart = position_m[..., :, None, :] - position_m[..., None, :, :]
    distance = np.sqrt(np.square(apart).sum(-1))
    radii = np.broadcast_to(np.asarray(radius_m, np.float64), position_m.shape[-2:-1])
    gap = distance - (radii[:, None] + radii[None, :])
    touching = (gap <= 0.0) & (distance >= LEAST_DISTANCE_M)
    penetration = CONTACT_WIDTH_M * np.logaddexp(0.0, np.where(touching, -gap, 0.0) / CONTACT_WIDTH_M)
    size = np.where(touching, STIFFNESS_N_M * penetration / np.maximum(distance, LEAST_DISTANCE_M), 0.0)
    force: Floats = (size[..., None] * apart).sum(-2)
    return force
