"""What an episode of a scene comes to."""

import numpy as np
from msgspec.structs import replace

from benchmarks.paper.steering.scenes import Scene
from benchmarks.paper.tasks import TASKS
from edge_runtime.common.arrays import Floats
from edge_runtime.objectives import Geofence
from export.episodes.judges import Flags, motion
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import FACTS
from export.scenarios.scenario import Scenario, Transition
from export.scenarios.violations import violations

BROKEN = 1e-3
"""Least violation, as `violations` bounds them, that counts: VMAS computes in single precision."""


class SceneJudge:
    """Follows E episodes: arrivals as Navigation's own judge does, and each objective that is to be kept."""

    def __init__(self, scene: Scene, episodes: int) -> None:
        self.running: Flags = np.ones(episodes, bool)
        self._scene, self._arrivals = scene, TASKS["navigation"].judge(episodes)
        self._kept = tuple(
            replace(each, buffer_m=0.0) if isinstance(each, Geofence) else each
            for each in (scene.objectives[place] for place in scene.kept)
        )
        self._steps, self._broken = np.zeros((episodes, 1)), np.zeros((episodes, len(self._kept)))
        self._side = np.zeros(episodes)

    def add(self, world: Scenario, transition: Transition) -> None:
        """Count a step in which any robot violates an objective against that objective."""
        found = violations(self._kept, FACTS.motion, *world.motion()).numpy()
        self._broken += self.running[:, None] * (found > BROKEN).any(1)
        self._steps += self.running[:, None]
        position, _ = motion(world)
        apart = position[:, 0] - position[:, 1]
        self._side = np.where((self._side == 0.0) & (apart[:, 1] > 0.0), np.sign(apart[:, 0]), self._side)
        self._arrivals.add(world, transition)
        self.running = self._arrivals.running

    def broken(self) -> Floats:
        """Share of the steps in which each kept objective was violated, (E, M)."""
        return self._broken / self._steps

    def arrived(self) -> Flags:
        """Who arrived without a collision, (E,), and on the side that the scene asks for."""
        right = self._side > 0.0 if self._scene.on_the_right else True
        return (self._arrivals.outcome().nominal > 0.0) & right

    def satisfied(self) -> Flags:
        """Who arrived, and kept every objective that is to be kept in nine tenths of the steps, (E,)."""
        return self.arrived() & (self.broken() <= NAVIGATION.tolerance).all(1)
