"""Robots on wheels that slip: a team in MuJoCo that moves as its wheel controllers and the ground let it.

Obstacles push robots and are not pushed themselves: they stand, or walk straight on.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import mujoco
import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.config.fleet import Obstacle
from edge_runtime.messages import Vector2
from edge_runtime.motion.range_sensor import Disc
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.simulation.wheels.bases import WheeledBase
from firmware_bridge.simulation.wheels.mjcf import GROUND, STEP_S, mjcf
from firmware_bridge.simulation.wheels.traction import Traction

SETTLING_S: Final = 0.25
"""In which robots come to rest on their wheels."""


class WheeledState(NamedTuple):
    """How a base moves, in the team's frame."""

    position_m: Vector2
    """Of its middle."""
    heading_rad: float
    forward_m_s: float
    left_m_s: float
    yaw_rad_s: float


class WheeledTeam:
    """N robots of one base, at rest.

    Args:
        base: theirs.
        positions_m: where the middles of the bases are.
        headings_rad: where they look.
        friction: between wheels and ground.
        payload_kg: what each carries on its top.
        obstacles: M discs in their way.
    """

    def __init__(
        self,
        base: WheeledBase,
        positions_m: Sequence[Vector2],
        headings_rad: Sequence[float],
        friction: float,
        payload_kg: float = 0.0,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        poses = [(x, y, yaw) for (x, y), yaw in zip(positions_m, headings_rad, strict=True)]
        count = len(poses)
        self.base = base
        self.model = mujoco.MjModel.from_xml_string(mjcf(base, poses, payload_kg, obstacles))
        self.data = mujoco.MjData(self.model)
        self.touched: set[tuple[int, ...]] = set()
        """(i, j), i < j, of the bodies that have touched so far, robots first, then obstacles."""
        self._traction, self._due_s = Traction(base, friction), 0.0
        self._load, self._controller = np.zeros((count, 4)), np.zeros((count, 3))
        changes = base.acceleration_m_s2, base.acceleration_m_s2, base.yaw_acceleration_rad_s2
        self._change = STEP_S * np.array(changes)
        sideways = base.max_speed_m_s if base.mecanum else 0.0
        self._greatest = np.array([base.max_speed_m_s, sideways, base.kinematics.max_yaw_rad_s])
        units = BaseMotion(1.0), BaseMotion(0.0, 1.0), BaseMotion(0.0, 0.0, 1.0)
        self._rates = np.array([base.rim_speeds_m_s(unit) for unit in units]) / base.wheel_radius_m
        # Views of one row for each robot.
        self._place, self._speed = self.data.qpos.reshape(count, -1), self.data.qvel.reshape(count, -1)
        bodies = self.data.xfrc_applied[1 : self.model.nbody - len(obstacles)]
        self._push = bodies.reshape(count, -1, 6)[:, 1:5]
        self._radii = [one.radius_m for one in obstacles]
        self._walk = STEP_S * np.array([one.velocity_m_s for one in obstacles]).reshape(-1, 2)
        names = [*(f"robot{i}" for i in range(count)), *(f"obstacle{i}" for i in range(len(obstacles)))]
        self._solid = np.array([self.model.geom(name).id for name in names])
        self._wheel = np.array(
            [[self.model.geom(f"wheel{i}_{j}").id for j in range(4)] for i in range(count)]
        )
        for _ in range(round(SETTLING_S / STEP_S)):
            self._advance()

    def step(self, motions: Sequence[BaseMotion], period_s: float) -> None:
        """Advance, by whole steps of STEP_S over time, while each wheel controller is told its motion."""
        told = np.array([(each.forward_m_s, each.lateral_m_s, each.yaw_rad_s) for each in motions])
        told = np.clip(told, -self._greatest, self._greatest)
        self._due_s += period_s
        while self._due_s >= STEP_S / 2:
            self._due_s -= STEP_S
            self._controller += np.clip(told - self._controller, -self._change, self._change)
            self.data.ctrl[:] = (self._controller @ self._rates).ravel()
            self.data.mocap_pos[:, :2] += self._walk
            self._advance()

    def state(self, robot: int) -> WheeledState:
        """How the robot at this place in the order moves."""
        heading = _headings(self._place[robot])
        forward, left = _turned(self._speed[robot, :2], -heading).tolist()
        x, y = self._place[robot, :2].tolist()
        return WheeledState((x, y), float(heading), forward, left, float(self._speed[robot, 5]))

    def obstacles(self) -> list[Disc]:
        """The obstacles as they are now."""
        places = self.data.mocap_pos[:, :2].tolist()
        return [(x, y, radius) for (x, y), radius in zip(places, self._radii, strict=True)]

    def _advance(self) -> None:
        """One step of MuJoCo's, under the friction of this moment."""
        headings, speed = _headings(self._place), self._speed[:, :6].copy()
        speed[:, :2] = _turned(speed[:, :2], -headings)
        slip = self._traction.slip_m_s(speed, self._speed[:, 6:])
        force = _turned(self._traction.forces_n(slip, self._load), headings[:, None])
        self._push[..., :2] = force  # at the wheels' middles, and with it the torque of the way to their feet
        self._push[..., 3] = self.base.wheel_radius_m * force[..., 1]
        self._push[..., 4] = -self.base.wheel_radius_m * force[..., 0]
        mujoco.mj_step(self.model, self.data)
        self._look()

    def _look(self) -> None:
        """Take in what wheels bear, and who touches whom."""
        geoms, forces = self.data.contact.geom, np.append(self.data.efc_force, 0.0)
        standing = geoms[:, 0] == GROUND
        bears = np.zeros(self.model.ngeom)
        bears[geoms[standing, 1]] = forces[self.data.contact.efc_address[standing]]
        self._load[:] = bears[self._wheel]
        for pair in geoms[~standing].tolist():
            first, second = sorted(int(np.searchsorted(self._solid, geom)) for geom in pair)
            self.touched.add((first, second))


def _headings(places: Floats) -> Floats:
    """Of bases (..., 7 and more), whose attitude quaternions come after their positions."""
    w, x, y, z = np.moveaxis(places[..., 3:7], -1, 0)
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _turned(vectors: Floats, angles_rad: Floats) -> Floats:
    """Vectors (..., 2) turned counter-clockwise by angles (...)."""
    c, s, (x, y) = np.cos(angles_rad), np.sin(angles_rad), np.moveaxis(vectors, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y], -1)
