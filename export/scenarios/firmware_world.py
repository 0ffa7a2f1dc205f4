"""The harness's world in VMAS's own physics: what the robots' firmware drives carries, or gathers.

A robot's firmware turns the velocity that it is told back into the force that the policy meant,

    u = m (v_told - keep v) / T,   T the control period,

clipped to the policy's limits: against a load it pushes as hard as it was asked to, and no harder.
"""

from collections.abc import Sequence
from typing import Final

from edge_runtime.config.fleet import Fleet
from edge_runtime.messages import Vector
from edge_runtime.policy.manifest import Manifest
from export.scenarios.plant import VmasPlant
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.planar_world import PlanarWorld
from firmware_bridge.sil.firmware.world import Standing, World
from firmware_bridge.simulation.plants import Motion

STEPS: Final = 2
"""Of the harness's in one of VMAS's, which takes some milliseconds."""


class VmasWorld(PlanarWorld):
    """See `firmware_bridge.sil.firmware.planar_world.PlanarWorld`.

    Args:
        fleet: names the scenario, and where everything is.
        manifests: dynamics, body and action limits of each robot.
        standings: of each; the scenario puts those that it moves itself.
        period_s: of one step.
        control_s: the control period.
    """

    def __init__(
        self,
        fleet: Fleet,
        manifests: Sequence[Manifest],
        standings: Sequence[Standing],
        period_s: float,
        control_s: float,
    ) -> None:
        self._vmas = VmasPlant(fleet, STEPS * period_s)
        super().__init__(manifests, standings, period_s, fleet.team.scale_m, control_s)
        self._look()
        self._step = 0

    def step(self, motions: Sequence[BaseMotion]) -> None:
        """Advance one period while each robot follows what it was told."""
        self._step += 1
        if self._step % STEPS == 0:
            self._vmas.push([self.action(robot, motion) for robot, motion in enumerate(motions)])
            self._look()
        self.turn()

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', in the fleet file's order."""
        return self._vmas.objects()

    def reading(self, robot: int, sensor: str) -> Vector:
        """What the scenario lets a robot observe under the sensor's name."""
        return self._vmas.reading(robot, sensor)

    def _look(self) -> None:
        seen = self._vmas.motions()
        self.position_m[:] = [motion.position_m for motion in seen]
        self.velocity_m_s[:] = [motion.velocity_m_s for motion in seen]


def make_world(
    fleet: Fleet,
    manifests: Sequence[Manifest],
    standings: Sequence[Standing],
    period_s: float,
    control_s: float,
) -> World:
    """See `firmware_bridge.sil.firmware.planar_world.make_world`."""
    return VmasWorld(fleet, manifests, standings, period_s, control_s)
