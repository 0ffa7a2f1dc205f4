"""Teams on wheels, side by side in one world, too far from each other to meet."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from benchmarks.obstacles.worlds import scattered
from edge_runtime.common.arrays import Floats
from firmware_bridge.kinematics.base import BaseMotion, motion_for
from firmware_bridge.simulation.wheels.bases import WheeledBase
from firmware_bridge.simulation.wheels.team import WheeledTeam

FAR_M: Final = 1000.0
"""From one team to the next."""
APART_M: Final = 0.35
"""Between starts and between goals, in the policy's metres: hulls do not overlap, however they look."""


class Places(NamedTuple):
    """Where E teams of N robots start and go to, in the policy's metres, of their points of reference."""

    starts: Floats
    """(E, N, 2)"""
    goals: Floats
    headings_rad: Floats
    """(E, N)"""


def drawn(seeds: Sequence[int], robots: int) -> Places:
    """Draw an episode for each seed; the field is as crowded for many as for four."""
    half = max(1.0, 0.5 * math.sqrt(robots))
    draws = [np.random.default_rng(seed) for seed in seeds]
    starts, goals = (np.array([scattered(draw, robots, half, APART_M) for draw in draws]) for _ in range(2))
    return Places(starts, goals, np.array([draw.uniform(-math.pi, math.pi, robots) for draw in draws]))


class Teams:
    """E teams of N robots of one base, in the policy's metres.

    Args:
        base: theirs.
        scale_m: one of the policy's metres.
        places: where they start.
        friction: of the ground.
    """

    def __init__(self, base: WheeledBase, scale_m: float, places: Places, friction: float) -> None:
        self._base, self._scale_m = base, scale_m
        self._ahead_m = base.kinematics.reference_m
        self.count, self.robots = places.headings_rad.shape
        self._corner = np.zeros((self.count * self.robots, 2))
        self._corner[:, 0] = FAR_M * np.repeat(np.arange(self.count), self.robots)
        headings = places.headings_rad.ravel()
        middles = scale_m * places.starts.reshape(-1, 2) + self._corner - self._ahead(headings)
        rows = [(x, y) for x, y in middles.tolist()]
        self.world = WheeledTeam(base, rows, headings.tolist(), friction)
        self.look()

    def look(self) -> None:
        """Take in where everybody is, and how fast: `position` and `velocity` (E, N, 2)."""
        states = [self.world.state(robot) for robot in range(self.count * self.robots)]
        middles = np.array([state.position_m for state in states])
        self.heading_rad = np.array([state.heading_rad for state in states])
        forward = np.array([state.forward_m_s for state in states])
        left = np.array([state.left_m_s + self._ahead_m * state.yaw_rad_s for state in states])
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        velocity = np.stack([c * forward - s * left, s * forward + c * left], -1)
        shape = self.count, self.robots, 2
        place = middles + self._ahead(self.heading_rad) - self._corner
        self.position, self.velocity = (
            (place / self._scale_m).reshape(shape),
            velocity.reshape(shape) / self._scale_m,
        )

    def told(self, velocity: Floats) -> list[BaseMotion]:
        """What bases make of velocities (E, N, 2), each no faster than it can go."""
        wanted = self._scale_m * velocity.reshape(-1, 2)
        speed = np.linalg.norm(wanted, axis=-1, keepdims=True)
        most = self._base.max_speed_m_s
        wanted = wanted * (most / np.maximum(speed, most))
        pairs = zip(wanted.tolist(), self.heading_rad.tolist(), strict=True)
        return [motion_for(tuple(one), heading, self._base.kinematics) for one, heading in pairs]

    def touched(self) -> Floats:
        """Which teams (E,) had a contact."""
        hit = np.zeros(self.count, bool)
        hit[[first // self.robots for first, _ in self.world.touched]] = True
        return hit

    def _ahead(self, headings: Floats) -> Floats:
        return self._ahead_m * np.stack([np.cos(headings), np.sin(headings)], -1)
