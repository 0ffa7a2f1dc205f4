"""The plant ``discs``, the default, on a robot's own small install: `firmware_bridge.simulation.plant`.

Tracked objects stand where the fleet file puts them.
"""

from collections.abc import Sequence
from typing import Final

from edge_runtime.common.toml_file import refuse
from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command, Vector
from edge_runtime.motion.range_sensor import Disc
from firmware_bridge.simulation.plant import Plant
from firmware_bridge.simulation.plants import Motion


class Discs:
    """A fleet's robots as discs, see `firmware_bridge.simulation.plants.TeamPlant`."""

    sensors: Final = frozenset[str]()

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self.reset()

    def reset(self) -> None:
        """Put everything where the fleet file has it."""
        fleet, manifest = self._mission.fleet, self._mission.bundle.manifest
        robots = fleet.robots if fleet.carrier is None else (fleet.robot(self._mission.robot_id),)
        if fleet.obstacles and manifest.motion.dims == 3:
            refuse(fleet.path, "obstacle", "is a disc in the plane; the policy moves in space")
        self.world = Plant(
            manifest.motion.at_period(self._mission.period_s),
            manifest.body.radius_m,
            [robot.start_m for robot in robots],
            fleet.obstacles,
            fleet.team.scale_m,
            [robot.start_heading_rad for robot in robots],
        )
        self.radius_m, self.touched = manifest.body.radius_m, self.world.touched

    def drive(self, commands: Sequence[Command]) -> None:
        """Advance by one control period."""
        self.world.step([command.action for command in commands])

    def motions(self) -> Sequence[Motion]:
        """The robots', in order."""
        states = (self.world.state(robot, robot, 0.0) for robot in range(len(self.world.position_m)))
        return [
            Motion(each.position_m, each.velocity_m_s, each.heading_rad, each.yaw_rate_rad_s)
            for each in states
        ]

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', at rest; among robots in space on the ground."""
        dims = self._mission.bundle.manifest.motion.dims
        tracked, rest = self._mission.fleet.tracked, (0.0,) * dims
        return [Motion((*each.start_m, 0.0)[:dims], rest) for each in tracked]

    def obstacles(self) -> Sequence[Disc]:
        """As they are now."""
        return self.world.obstacles()

    def reading(self, robot: int, sensor: str) -> Vector:
        """Raise: there are no sensors."""
        raise KeyError(sensor, robot)


def make_plant(mission: Mission) -> Discs:
    """Simulate a mission's fleet, or its robot only where the others are processes of their own."""
    return Discs(mission)
