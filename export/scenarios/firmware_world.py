"""The harness's world in VMAS's own physics: what the robots' firmware drives carries, or gathers.

A robot's firmware turns the velocity that it is told back into the force that the policy meant,

    u = m (v_told - keep v) / T,   T the control period,

clipped to the policy's limits: against a load it pushes as hard as it was asked to, and no harder.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from edge_runtime.config.fleet import Fleet
from edge_runtime.messages import Vector, Vector2
from edge_runtime.policy.manifest import Manifest
from export.scenarios.plant import VmasPlant
from firmware_bridge.sil.firmware.world import World, pushed
from firmware_bridge.simulation.plants import Motion

STEPS: Final = 2
"""Of the harness's in one of VMAS's, which takes some milliseconds."""


class VmasWorld(World):
    """See `firmware_bridge.sil.firmware.world.World`.

    Args:
        fleet: names the scenario, and where everything is.
        manifests: dynamics, body and action limits of each robot.
        headings_rad: where the bases look.
        ahead_m: distance from the axle to the disc's centre.
        period_s: of one step.
        control_s: the control period.
    """

    def __init__(
        self,
        fleet: Fleet,
        manifests: Sequence[Manifest],
        headings_rad: Sequence[float],
        ahead_m: float,
        period_s: float,
        control_s: float,
    ) -> None:
        self._plant = VmasPlant(fleet, STEPS * period_s)
        starts = [motion.position_m[:2] for motion in self._plant.motions()]
        places: list[Vector2] = [(x, y) for x, y in starts]
        super().__init__(manifests, places, headings_rad, ahead_m, period_s, fleet.team.scale_m)
        models = [pushed(manifest).at_period(control_s) for manifest in manifests]
        self._told_keep = np.array([[1.0 - one.drag] for one in models])
        self._told_gain = np.array([[one.mass_kg / control_s] for one in models])
        self._step = 0

    def step(self, motions: Sequence[Vector2]) -> None:
        """Advance one period while each robot follows (forward m/s, yaw rad/s)."""
        self._step += 1
        if self._step % STEPS == 0:
            missing = self._wanted(motions) - self._told_keep * self.velocity_m_s
            action = np.clip(self._told_gain * missing, self._low, self._high)
            self._plant.push(action.tolist())
            seen = self._plant.motions()
            self.position_m[:] = [motion.position_m for motion in seen]
            self.velocity_m_s[:] = [motion.velocity_m_s for motion in seen]
        self._turn()

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', in the fleet file's order."""
        return self._plant.objects()

    def reading(self, robot: int, sensor: str) -> Vector:
        """What the scenario lets a robot observe under the sensor's name."""
        return self._plant.reading(robot, sensor)
