"""The bridge to a simulated team: the plant and the other robots run in this process."""

import argparse
import math
import time
from collections.abc import Callable, Mapping, Sequence

import msgspec

from edge_runtime.common.closing import Closing
from edge_runtime.control.controller import Controller
from edge_runtime.control.limits import first_command
from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command, Reading, RobotState, Teammate, TeamState, TrackedObject, Vector
from edge_runtime.motion.range_sensor import RangeSensor
from firmware_bridge.simulation.plants import PLANTS, TeamPlant, open_plant


class SimBridge(Closing):
    """One robot's link to a simulated team; also its `edge_runtime.team.membership.FleetLink`.

    Every read after the first one lets the whole team move for one period. The other robots decide on the
    states that this robot saw; a command moves this robot for one period only, and without one it coasts.

    Args:
        robot_id: the robot at this end of the link.
        plant: the team.
        objects: names and goals of the tracked objects, in the plant's order.
        first: what counts as every robot's command before its first, by id, in the plant's order.
        mates: the other robots' controllers by id.
        sensor: by which robots see each other and the plant's obstacles; None where there are only robots
            to see, which everybody computes from their states.
        clock: monotonic time in seconds.
    """

    name = "sim"
    max_speed_m_s = max_yaw_rate_rad_s = math.inf
    complaints: tuple[str, ...] = ()
    poses = None
    withholds = ""
    reaction = None

    def __init__(
        self,
        robot_id: int,
        plant: TeamPlant,
        objects: Sequence[tuple[str, Vector | None]],
        first: Mapping[int, Command],
        mates: Mapping[int, Controller],
        sensor: RangeSensor | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.robot_id = robot_id
        self.plant = plant
        self._ids, self._mates, self._sensor, self._clock = tuple(first), mates, sensor, clock
        self._objects, self._tracked = objects, tuple[TrackedObject, ...]()
        self._first, self._commands = first, dict(first)
        self._team: dict[int, Teammate] = {}

    def close(self) -> None:
        """Stop the robot."""
        self.stop("the link is closed")

    def read(self) -> RobotState:
        """Advance the team by one period, except the first time, and return the robot's state."""
        if self._team:
            self._advance()
        self._team = self._measure()
        self._rest()
        return self._team[self.robot_id].state

    def teammates(self) -> tuple[Teammate, ...]:
        """The other robots' states in the same instant, with the actions that they commanded last."""
        return self._others(self.robot_id)

    def ranges_m(self) -> tuple[float, ...] | None:
        """What the robot's range sensor read in the same instant."""
        return self._ranges(self.robot_id)

    def tracked(self) -> tuple[TrackedObject, ...]:
        """The tracked objects in the same instant."""
        return self._tracked

    def readings(self) -> tuple[Reading, ...]:
        """What the robot's further sensors read in the same instant."""
        return self._readings(self.robot_id)

    def write(self, command: Command) -> None:
        """Move the robot by this command during the next period."""
        self._commands[self.robot_id] = command

    def stop(self, reason: str) -> None:  # noqa: ARG002  # the simulated firmware keeps no log
        """Let the robot coast."""
        self._rest()

    def _advance(self) -> None:
        for robot_id, controller in self._mates.items():
            own = self._team[robot_id].state
            # These states are from this robot's last tick: fresh to whoever lives in simulated time.
            view = TeamState(
                own,
                self._others(robot_id),
                ranges_m=self._ranges(robot_id),
                tracked=self._tracked,
                readings=self._readings(robot_id),
            )
            self._commands[robot_id] = controller.decide(view, own.stamp_s)
        self.plant.drive([self._commands[robot_id] for robot_id in self._ids])

    def _measure(self) -> dict[int, Teammate]:
        now = self._clock()
        self._tracked = tuple(
            TrackedObject(name, now, *motion, goal_m=goal_m)
            for (name, goal_m), motion in zip(self._objects, self.plant.objects(), strict=True)
        )
        return {
            robot_id: Teammate(RobotState(robot_id, now, *motion), self._commands[robot_id].action)
            for robot_id, motion in zip(self._ids, self.plant.motions(), strict=True)
        }

    def _rest(self) -> None:
        """Forget the robot's command: it coasts."""
        self._commands[self.robot_id] = self._first[self.robot_id]

    def _readings(self, robot_id: int) -> tuple[Reading, ...]:
        place = self._ids.index(robot_id)
        return tuple(Reading(name, self.plant.reading(place, name)) for name in sorted(self.plant.sensors))

    def _others(self, robot_id: int) -> tuple[Teammate, ...]:
        return tuple(mate for other, mate in self._team.items() if other != robot_id)

    def _ranges(self, robot_id: int) -> tuple[float, ...] | None:
        if self._sensor is None:
            return None
        own = self._team[robot_id].state.position_m
        mates = self._sensor.discs(own, (mate.state.position_m for mate in self._others(robot_id)))
        return tuple(self._sensor.readings(own, [*mates, *self.plant.obstacles()]))


class SimFlags(msgspec.Struct, frozen=True):
    """What the command line says of the simulation."""

    plant: str | None = None
    """One of `PLANTS`; the fleet file's where None."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flag that only a simulated team has."""
    parser.add_argument(
        "--plant",
        choices=tuple(PLANTS),
        help="what moves the simulated team (default: the fleet's, else discs); the others are workstations'",
    )


def options_from(flags: argparse.Namespace) -> SimFlags:
    """Return what the command line says."""
    return SimFlags(flags.plant)


def open_bridge(mission: Mission, options: SimFlags = SimFlags()) -> SimBridge:  # noqa: B008  # frozen
    """Simulate the mission's fleet, or this robot only where the others are processes of their own.

    Others that are simulated run the mission's policy and objectives.

    Raises:
        ConfigError: as `open_plant`.
    """
    fleet, manifest = mission.fleet, mission.bundle.manifest
    robots = fleet.robots if fleet.carrier is None else (fleet.robot(mission.robot_id),)
    mates = {robot.id: mission.controller(robot.id) for robot in robots if robot.id != mission.robot_id}
    plant = open_plant(mission, options.plant)
    sensor = manifest.body.sensor() if fleet.obstacles else None
    objects = [(each.name, each.goal_m) for each in fleet.tracked]
    sizes = manifest.action_dim, manifest.motion.dims
    first = {robot.id: first_command(robot.id, *sizes) for robot in robots}
    return SimBridge(mission.robot_id, plant, objects, first, mates, sensor)
