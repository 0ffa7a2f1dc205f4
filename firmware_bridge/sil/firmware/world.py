"""What every world that firmware drives tells of its robots, in the team's frame.

A robot's disc sits on the point that its base steers: that far ahead of its axle, see `Standing.ahead_m`.
"""

import abc
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.messages import Vector, Vector2
from edge_runtime.motion.range_sensor import Disc
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.kinematics.frames import rotate
from firmware_bridge.simulation.plants import Motion


class BaseState(NamedTuple):
    """A base as its firmware could measure it, in the team's frame (ENU)."""

    position_m: Vector2
    """Of the axle."""
    heading_rad: float
    forward_m_s: float
    yaw_rad_s: float
    lateral_m_s: float = 0.0
    """To the left."""


class Standing(NamedTuple):
    """Where a robot begins, and what its base steers."""

    start_m: Vector2
    """Of its disc."""
    heading_rad: float
    ahead_m: float
    """From the axle to the point that is steered, which may go anywhere; 0: that is the axle."""


class World(abc.ABC):
    """N robots on bases.

    Args:
        standings: of each.
        radius_m: of each one's disc.
    """

    def __init__(self, standings: Sequence[Standing], radius_m: Sequence[float]) -> None:
        self.position_m: Floats = np.array([one.start_m for one in standings], np.float64)
        self.velocity_m_s: Floats = np.zeros_like(self.position_m)
        self.heading_rad: Floats = np.array([one.heading_rad for one in standings], np.float64)
        self.yaw_rate_rad_s: Floats = np.zeros(len(standings))
        self.radius_m: Floats = np.array(radius_m, np.float64)
        self.ahead_m = [one.ahead_m for one in standings]

    @abc.abstractmethod
    def step(self, motions: Sequence[BaseMotion]) -> None:
        """Advance one period while each robot follows what it was told."""

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', in the fleet file's order."""
        return ()

    def obstacles(self) -> Sequence[Disc]:
        """What stands or walks in the robots' way."""
        return ()

    def reading(self, robot: int, sensor: str) -> Vector:
        """What a robot's further sensor reads: none has any here."""
        raise KeyError(sensor, robot)

    def state(self, robot: int) -> BaseState:
        """Return what the firmware of the robot at this place in the order measures."""
        x, y = self.position_m[robot].tolist()
        v_x, v_y = self.velocity_m_s[robot].tolist()
        heading, yaw, ahead_m = (
            float(self.heading_rad[robot]),
            float(self.yaw_rate_rad_s[robot]),
            self.ahead_m[robot],
        )
        back_x, back_y = rotate((ahead_m, 0.0), heading)
        forward, left = rotate((v_x, v_y), -heading)
        return BaseState((x - back_x, y - back_y), heading, forward, yaw, left - ahead_m * yaw)

    def speeds_m_s(self) -> Floats:
        """Return the discs' speeds (N,)."""
        return np.hypot(self.velocity_m_s[:, 0], self.velocity_m_s[:, 1])

    def touching(self) -> npt.NDArray[np.bool_]:
        """Which robots touch each other now (N, N)."""
        touching: npt.NDArray[np.bool_] = self.distances_m() <= self.radius_m[:, None] + self.radius_m[None]
        return touching

    def bumping(self) -> npt.NDArray[np.bool_]:
        """Which robots touch which obstacles now (N, M)."""
        x, y, radius = np.array(self.obstacles(), np.float64).reshape(-1, 3).T
        apart = np.hypot(self.position_m[:, :1] - x, self.position_m[:, 1:] - y)
        bumping: npt.NDArray[np.bool_] = apart <= self.radius_m[:, None] + radius
        return bumping

    def distances_m(self) -> Floats:
        """Return the distances between the discs' centres (N, N), infinite from each to itself."""
        apart = self.position_m[:, None] - self.position_m[None]
        distances: Floats = np.hypot(apart[..., 0], apart[..., 1])
        np.fill_diagonal(distances, math.inf)
        return distances
