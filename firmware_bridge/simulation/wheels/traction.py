"""What the ground does to wheels that slip.

With u the velocity, ahead and to the left, at which the foot of a wheel slips over the ground, and N what the
wheel bears, the ground pushes the foot by Coulomb's friction, into which a tyre's give leads:

    F = -N min(mu, |D u| / YIELD_M_S) D u / |D u|

A tyre grips ahead and sideways, D = 1. Rollers of a mecanum wheel turn freely, so that it grips along their
axis a alone, D = a a^T.
"""

from typing import Final

import numpy as np

from edge_runtime.common.arrays import Floats
from firmware_bridge.simulation.wheels.bases import WHEELS, WheeledBase

YIELD_M_S: Final = 0.1
"""Slip at which a tyre would push with its whole load, if the ground did not give way before."""


class Traction:
    """Of one kind of base on one ground.

    Args:
        base: whose wheels they are.
        friction: mu.
    """

    def __init__(self, base: WheeledBase, friction: float) -> None:
        self._friction, self._radius_m = friction, base.wheel_radius_m
        ahead, left = np.array(WHEELS, np.float64).T
        self._ahead_m, self._left_m = ahead * base.wheelbase_m / 2, left * base.track_m / 2
        self._axes = np.stack([np.ones(4), -ahead * left], -1) / np.sqrt(2.0) if base.mecanum else None

    def slip_m_s(self, velocity: Floats, rates: Floats) -> Floats:
        """How the feet of the wheels slip.

        Args:
            velocity: (N, 6), of each base ahead, left and up in m/s, and about these axes in rad/s.
            rates: (N, 4), of the wheels in their bearings, in rad/s.

        Returns:
            (N, 4, 2), ahead and left.
        """
        forward, left, _, roll, pitch, yaw = velocity.T[:, :, None]
        ahead = forward - yaw * self._left_m - self._radius_m * (pitch + rates)
        return np.stack([ahead, left + yaw * self._ahead_m + self._radius_m * roll], -1)

    def forces_n(self, slip_m_s: Floats, load_n: Floats) -> Floats:
        """The ground's on the feet (N, 4, 2), of their slip (N, 4, 2) and loads (N, 4)."""
        axes, gripped = self._axes, slip_m_s
        if axes is not None:
            gripped = (slip_m_s * axes).sum(-1, keepdims=True) * axes
        speed = np.hypot(gripped[..., 0], gripped[..., 1])
        pull = self._friction / np.maximum(speed, self._friction * YIELD_M_S)
        forces: Floats = -(load_n * pull)[..., None] * gripped
        return forces
