"""The plant that the firmware nodes drive: the manifest's dynamics, VMAS's contacts, wheels that turn.

A robot's disc sits on the point that its base steers (`firmware_bridge.kinematics.base.Base.reference_m`
ahead of the axle), which can move in any direction: forward with the wheels, sideways with the yaw rate. Its
firmware follows a commanded motion as hard as the manifest's action limits allow.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.errors import BundleError
from edge_runtime.messages import Vector, Vector2
from edge_runtime.motion.point import PointForce
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.kinematics.frames import rotate, wrap
from firmware_bridge.simulation.plant import contact_forces
from firmware_bridge.simulation.plants import Motion


class BaseState(NamedTuple):
    """A base as its firmware could measure it, in the team's frame (ENU)."""

    position_m: Vector2
    """Of the axle."""
    heading_rad: float
    forward_m_s: float
    yaw_rad_s: float


class World:
    """N robots on differential bases, at rest.

    Args:
        manifests: dynamics, body and action limits of each robot.
        starts_m: where the discs are.
        headings_rad: where the bases look.
        ahead_m: distance from the axle to the disc's centre; positive.
        period_s: of one step.
        scale_m: one of the policy's metres, in the robots'.
    """

    def __init__(
        self,
        manifests: Sequence[Manifest],
        starts_m: Sequence[Vector2],
        headings_rad: Sequence[float],
        ahead_m: float,
        period_s: float,
        scale_m: float = 1.0,
    ) -> None:
        self.position_m: Floats = np.array(starts_m, np.float64)
        self.velocity_m_s: Floats = np.zeros_like(self.position_m)
        self.radius_m: Floats = np.array([manifest.body.radius_m for manifest in manifests])
        self._headings = list(headings_rad)
        self._ahead_m, self._period_s, self._scale_m = ahead_m, period_s, scale_m
        self._low = np.array([[field.low for field in manifest.action] for manifest in manifests])
        self._high = np.array([[field.high for field in manifest.action] for manifest in manifests])
        models = [pushed(manifest).at_period(period_s) for manifest in manifests]
        self._keep = np.array([[1.0 - one.drag] for one in models])
        self._mass_kg = np.array([[one.mass_kg] for one in models])
        self._substeps = max(one.substeps for one in models)

    def step(self, motions: Sequence[Vector2]) -> None:
        """Advance one period while each robot follows (forward m/s, yaw rad/s); the model of `Plant`."""
        wanted = self._wanted(motions)
        self.velocity_m_s *= self._keep
        needed = (wanted - self.velocity_m_s) * self._mass_kg / self._period_s
        force = np.clip(needed, self._low, self._high)
        substep_s = self._period_s / self._substeps
        for _ in range(self._substeps):
            push = contact_forces(self.position_m, self.radius_m, self._scale_m)
            self.velocity_m_s += (force + push) / self._mass_kg * substep_s
            self.position_m += self.velocity_m_s * substep_s
        self._turn()

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', in the fleet file's order."""
        return ()

    def reading(self, robot: int, sensor: str) -> Vector:
        """What a robot's further sensor reads: none has any here."""
        raise KeyError(sensor, robot)

    def _wanted(self, motions: Sequence[Vector2]) -> Floats:
        """Velocities (N, 2) of the discs by which the bases would follow these motions."""
        ahead_m, pairs = self._ahead_m, zip(motions, self._headings, strict=True)
        return np.array([rotate((forward, ahead_m * yaw), heading) for (forward, yaw), heading in pairs])

    def _turn(self) -> None:
        """Turn the bases as their discs have moved."""
        for robot in range(len(self._headings)):
            self._headings[robot] = wrap(self._headings[robot] + self._period_s * self.state(robot).yaw_rad_s)

    def state(self, robot: int) -> BaseState:
        """Return what the firmware of the robot at this place in the order measures."""
        x, y = self.position_m[robot].tolist()
        v_x, v_y = self.velocity_m_s[robot].tolist()
        heading = self._headings[robot]
        back_x, back_y = rotate((self._ahead_m, 0.0), heading)
        forward, left = rotate((v_x, v_y), -heading)
        return BaseState((x - back_x, y - back_y), heading, forward, left / self._ahead_m)

    def speeds_m_s(self) -> Floats:
        """Return the discs' speeds (N,)."""
        return np.hypot(self.velocity_m_s[:, 0], self.velocity_m_s[:, 1])

    def distances_m(self) -> Floats:
        """Return the distances between the discs' centres (N, N), infinite from each to itself."""
        apart = self.position_m[:, None] - self.position_m[None]
        distances: Floats = np.hypot(apart[..., 0], apart[..., 1])
        np.fill_diagonal(distances, math.inf)
        return distances


def pushed(manifest: Manifest) -> PointForce:
    """Return the motion model of a policy whose robots the harness's firmware can be.

    Raises:
        BundleError: if it is another one than forces in the plane.
    """
    motion = manifest.motion
    if not isinstance(motion, PointForce) or motion.action_dim != 2:
        raise BundleError(
            f"{manifest.name}: motion.type is {motion.kind!r}, must be 'point_force' in the plane, which the "
            "harness's firmware follows"
        )
    return motion
