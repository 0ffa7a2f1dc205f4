"""The team's plant: bodies that a motion model moves and that push each other apart on contact.

Obstacles push the robots alike, and are not pushed themselves: they stand, or walk straight on.

Per substep, with gap = |p_i - p_j| - 2 r <= 0, the force on i along (p_i - p_j) / |p_i - p_j| is the
stiffness times the soft penetration w log(1 + exp(-gap / w)); drag acts once per step. This is the
contact model of VMAS 1.5.2 with its default numbers, so that a policy meets the world it was trained in.
"""

from collections.abc import Sequence
from itertools import zip_longest
from typing import Final

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from edge_runtime.common.arrays import Floats
from edge_runtime.config.fleet import Obstacle
from edge_runtime.messages import RobotState, Vector
from edge_runtime.motion.model import Model, preview
from edge_runtime.motion.models import MotionModel, PointAcceleration, PointForce
from edge_runtime.motion.range_sensor import Disc
from firmware_bridge.kinematics.frames import wrap

STIFFNESS_N_M: Final = 100.0
CONTACT_WIDTH_M: Final = 1e-3
"""w above: how softly the contact force sets in."""
LEAST_DISTANCE_M: Final = 1e-6
"""Centres nearer than this have no direction to part in, and feel no force."""
MASS_KG: Final = 1.0
"""In contacts, of robots whose motion model has none."""


class Plant:
    """N robots at rest: discs in the plane, balls in space.

    Args:
        motion: one control period of every robot, or of each.
        radius_m: of every robot, or of each.
        position_m: (N, dims) where they start.
        obstacles: M discs beside them, in the plane.
        scale_m: one of the policy's metres, in those of positions: contacts are as soft as there.
        heading_rad: (N,) where they look at first.
    """

    def __init__(
        self,
        motion: MotionModel | Sequence[MotionModel],
        radius_m: npt.ArrayLike,
        position_m: npt.ArrayLike,
        obstacles: Sequence[Obstacle] = (),
        scale_m: float = 1.0,
        heading_rad: npt.ArrayLike = 0.0,
    ) -> None:
        self._scale_m = scale_m
        self.position_m = np.array(position_m, np.float64)
        self.velocity_m_s = np.zeros_like(self.position_m)
        count = len(self.position_m)
        self.motions = [motion] * count if isinstance(motion, Model) else list(motion)
        self.heading_rad = np.broadcast_to(np.asarray(heading_rad, np.float64), count).copy()
        self.yaw_rate_rad_s = np.zeros(count)
        self.obstacle_m = np.array([obstacle.centre_m for obstacle in obstacles]).reshape(-1, 2)
        """(M, 2) where the obstacles are now."""
        self.touched: set[tuple[int, ...]] = set()
        """(i, j) of the bodies that have touched so far, robots first, then obstacles; j is a robot, or an
        obstacle that i ran into."""
        self._walk_m_s = np.array([obstacle.velocity_m_s for obstacle in obstacles]).reshape(-1, 2)
        radii = np.broadcast_to(np.asarray(radius_m, np.float64), count)
        self._radii = np.array([*radii, *(obstacle.radius_m for obstacle in obstacles)])
        self._rounds = list(zip_longest(*map(_substeps, self.motions)))
        self._mass_kg = np.array([[_mass_kg(each, scale_m)] for each in self.motions])

    def state(self, robot: int, robot_id: int, now_s: float) -> RobotState:
        """How the robot of an index moves, under its id and stamped with a time."""
        return RobotState(
            robot_id,
            now_s,
            tuple(self.position_m[robot].tolist()),
            tuple(self.velocity_m_s[robot].tolist()),
            float(self.heading_rad[robot]),
            float(self.yaw_rate_rad_s[robot]),
        )

    def step(self, actions: Sequence[Vector]) -> None:
        """Advance one control period under constant actions, (N, d)."""
        for models in self._rounds:
            passed_s = np.array([[model.dt_s if model else 0.0] for model in models])
            push = self._contact() / self._mass_kg * passed_s
            for robot, (model, action) in enumerate(zip(models, actions, strict=True)):
                if model:
                    self._move(robot, action, model)
            self.velocity_m_s += push
            self.position_m += push * passed_s
            self.obstacle_m += self._walk_m_s * passed_s.max()

    def obstacles(self) -> list[Disc]:
        """The obstacles as they are now."""
        radii = self._radii[len(self.position_m) :].tolist()
        return [(x, y, radius) for (x, y), radius in zip(self.obstacle_m.tolist(), radii, strict=True)]

    def _move(self, robot: int, action: Vector, model: MotionModel) -> None:
        moved = preview(model, 1).predict(self.state(robot, robot, 0.0), action)
        self.position_m[robot] = moved.position_m(model.dims)
        self.velocity_m_s[robot] = moved.velocity_m_s(model.dims)
        if model.turns:
            self.heading_rad[robot], self.yaw_rate_rad_s[robot] = wrap(moved.heading), moved.yaw_rate

    def _contact(self) -> Floats:
        """Contact forces on the robots (N, dims); keeps account of who touched."""
        count = len(self.position_m)
        bodies = self.position_m
        if len(self.obstacle_m):
            bodies = np.concatenate([bodies, self.obstacle_m])
        stiff, apart = _stiff_and_apart(bodies / self._scale_m, self._radii / self._scale_m)
        if stiff.any():
            self.touched.update(map(tuple, np.argwhere(np.triu(stiff)[:count]).tolist()))
        force: Floats = (stiff[..., None] * apart).sum(-2)[:count]
        return force


def _mass_kg(motion: MotionModel, scale_m: float) -> float:
    return motion.mass_kg if isinstance(motion, PointForce) else MASS_KG / scale_m


def _substeps(motion: MotionModel) -> list[MotionModel]:
    """The steps of one period between which contacts act: drag takes its share in the first."""
    if not isinstance(motion, PointForce | PointAcceleration) or motion.substeps == 1:
        return [motion]
    first = replace(motion, dt_s=motion.dt_s / motion.substeps, substeps=1)
    return [first, *[replace(first, drag=0.0, yaw_drag=0.0)] * (motion.substeps - 1)]


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
