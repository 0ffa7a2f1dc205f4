"""The plant ``mujoco``: a fleet's robots on wheels that slip.

Each robot's wheel controller is told what its command makes of its base. Teams steer and see the base's point
of reference: a fleet's starts and goals, distances and speeds are that point's.
"""

from collections.abc import Sequence
from typing import Final

from edge_runtime.common.toml_file import refuse
from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command, Vector, Vector2
from edge_runtime.motion.range_sensor import Disc
from firmware_bridge.kinematics.base import motion_for, turning
from firmware_bridge.kinematics.frames import rotate
from firmware_bridge.simulation.plants import Motion
from firmware_bridge.simulation.wheels.bases import BASES
from firmware_bridge.simulation.wheels.fit import check_fleet
from firmware_bridge.simulation.wheels.team import WheeledTeam


class WheeledPlant:
    """A fleet in MuJoCo, see `firmware_bridge.simulation.plants.TeamPlant`.

    Raises:
        ConfigError: says what of the fleet does not fit its base.
    """

    sensors: Final = frozenset[str]()

    def __init__(self, mission: Mission) -> None:
        fleet, manifest = mission.fleet, mission.bundle.manifest
        self._mission, self._settings = mission, fleet.simulation
        self.base, self.radius_m = BASES[fleet.simulation.base], manifest.body.radius_m
        check_fleet(fleet, manifest)
        self._kinematics = turning(self.base.kinematics) if manifest.motion.turns else self.base.kinematics
        self.reset()

    def reset(self) -> None:
        """Put everything where the fleet file has it."""
        fleet = self._mission.fleet
        robots = fleet.robots if fleet.carrier is None else (fleet.robot(self._mission.robot_id),)
        headings = [robot.start_heading_rad for robot in robots]
        middles: list[Vector2] = []
        for robot, heading in zip(robots, headings, strict=True):
            x, y = rotate((self._kinematics.reference_m, 0.0), heading)
            middles.append((robot.start_m[0] - x, robot.start_m[1] - y))
        settings, obstacles = self._settings, fleet.obstacles
        ground = settings.friction, settings.payload_kg
        self.team = WheeledTeam(self.base, middles, headings, *ground, obstacles)
        self._count, self.touched = len(robots), self.team.touched
        if self.touched:
            self._refuse(*min(self.touched))

    def drive(self, commands: Sequence[Command]) -> None:
        """Advance by one control period."""
        headings = [self.team.state(robot).heading_rad for robot in range(self._count)]
        motions = [
            motion_for(command.velocity_m_s, heading, self._kinematics, command.yaw_rate_rad_s)
            for command, heading in zip(commands, headings, strict=True)
        ]
        self.team.step(motions, self._mission.period_s)

    def motions(self) -> Sequence[Motion]:
        """The robots', in order."""
        return [self._motion(robot) for robot in range(self._count)]

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', at rest."""
        return [Motion(each.start_m, (0.0,) * len(each.start_m)) for each in self._mission.fleet.tracked]

    def obstacles(self) -> Sequence[Disc]:
        """As they are now."""
        return self.team.obstacles()

    def reading(self, robot: int, sensor: str) -> Vector:
        """Raise: there are no sensors."""
        raise KeyError(sensor, robot)

    def _refuse(self, first: int, second: int) -> None:
        """Say which bodies overlap at the start, robots before obstacles."""
        path, base, beyond = self._mission.fleet.path, self._settings.base, second - self._count
        if beyond < 0:
            what = f"this {base} and that of robots[{first}] overlap; move one, or turn it"
            refuse(path, f"robots[{second}].start_m", what)
        what = f"it and the {base} of robots[{first}] overlap at the start; move one, or turn the robot"
        refuse(path, f"obstacle[{beyond}].centre_m", what)

    def _motion(self, robot: int) -> Motion:
        """Of the robot's point of reference."""
        state, ahead_m = self.team.state(robot), self._kinematics.reference_m
        (x, y), heading = state.position_m, state.heading_rad
        along, across = rotate((ahead_m, 0.0), heading)
        left_m_s = state.left_m_s + ahead_m * state.yaw_rad_s
        velocity = rotate((state.forward_m_s, left_m_s), heading)
        return Motion((x + along, y + across), velocity, heading, state.yaw_rad_s)


def make_plant(mission: Mission) -> WheeledPlant:
    """Simulate a mission's fleet, or its robot only where the others are processes of their own."""
    return WheeledPlant(mission)
