"""The bridge to a simulated team: the plant and the other robots run in this process."""

import argparse
import math
import time
from collections.abc import Callable, Mapping

from edge_runtime.common.closing import Closing
from edge_runtime.common.toml_file import refuse
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command, Reading, RobotState, Teammate, TeamState, TrackedObject, Vector
from edge_runtime.motion.range_sensor import RangeSensor
from firmware_bridge.simulation.plant import Plant


class SimBridge(Closing):
    """One robot's link to a simulated team; also its `edge_runtime.team.membership.FleetLink`.

    Every read after the first one lets the whole team move for one period. The other robots decide on the
    states that this robot saw; a command moves this robot for one period only, and without one it coasts.

    Args:
        robot_id: the robot at this end of the link.
        plant: the team, in the order of ``ids``.
        ids: every robot's id.
        mates: the other robots' controllers by id.
        sensor: by which robots see each other and the plant's obstacles; None where there are only robots
            to see, which everybody computes from their states.
        clock: monotonic time in seconds.
    """

    name = "sim"
    max_speed_m_s = max_yaw_rate_rad_s = math.inf
    complaints: tuple[str, ...] = ()
    reaction = None

    def __init__(
        self,
        robot_id: int,
        plant: Plant,
        ids: tuple[int, ...],
        mates: Mapping[int, Controller],
        sensor: RangeSensor | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.robot_id = robot_id
        self.plant = plant
        self._ids, self._mates, self._sensor, self._clock = ids, mates, sensor, clock
        self._rest: Vector = (0.0,) * plant.motion.action_dim
        self._actions = dict.fromkeys(ids, self._rest)
        self._team: dict[int, Teammate] = {}

    def close(self) -> None:
        """Stop the robot."""
        self.stop("the link is closed")

    def read(self) -> RobotState:
        """Advance the team by one period, except the first time, and return the robot's state."""
        if self._team:
            self._advance()
        self._team = self._measure()
        self._actions[self.robot_id] = self._rest
        return self._team[self.robot_id].state

    def teammates(self) -> tuple[Teammate, ...]:
        """The other robots' states in the same instant, with the actions that they commanded last."""
        return self._others(self.robot_id)

    def ranges_m(self) -> tuple[float, ...] | None:
        """What the robot's range sensor read in the same instant."""
        return self._ranges(self.robot_id)

    def tracked(self) -> tuple[TrackedObject, ...]:
        """Return nothing: this plant moves robots alone."""
        return ()

    def readings(self) -> tuple[Reading, ...]:
        """Return nothing: these robots have no further sensors."""
        return ()

    def write(self, command: Command) -> None:
        """Move the robot by this command during the next period."""
        self._actions[self.robot_id] = command.action

    def stop(self, reason: str) -> None:  # noqa: ARG002  # the simulated firmware keeps no log
        """Let the robot coast."""
        self._actions[self.robot_id] = self._rest

    def _advance(self) -> None:
        for robot_id, controller in self._mates.items():
            own = self._team[robot_id].state
            # These states are from this robot's last tick: fresh to whoever lives in simulated time.
            view = TeamState(own, self._others(robot_id), ranges_m=self._ranges(robot_id))
            command = controller.decide(view, own.stamp_s)
            self._actions[robot_id] = command.action
        self.plant.step([self._actions[robot_id] for robot_id in self._ids])

    def _measure(self) -> dict[int, Teammate]:
        now = self._clock()
        return {
            robot_id: Teammate(self.plant.state(robot, robot_id, now), self._actions[robot_id])
            for robot, robot_id in enumerate(self._ids)
        }

    def _others(self, robot_id: int) -> tuple[Teammate, ...]:
        return tuple(mate for other, mate in self._team.items() if other != robot_id)

    def _ranges(self, robot_id: int) -> tuple[float, ...] | None:
        if self._sensor is None:
            return None
        places = (mate.state.position_m for mate in self._others(robot_id))
        mates = [(x, y, self.plant.radius_m) for x, y, *_ in places]
        discs = [*mates, *self.plant.obstacles()]
        return tuple(self._sensor.readings(self._team[robot_id].state.position_m, discs))


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """Add nothing: a simulated team needs no flags."""


def options_from(_flags: argparse.Namespace) -> None:
    """Return nothing; see `add_arguments`."""


def open_bridge(mission: Mission, _options: None = None) -> SimBridge:
    """Simulate the mission's fleet, or this robot only where the others are processes of their own.

    Others that are simulated run the mission's policy and objectives.
    """
    fleet, manifest = mission.fleet, mission.bundle.manifest
    robots = fleet.robots if fleet.carrier is None else (fleet.robot(mission.robot_id),)
    mates = {robot.id: mission.controller(robot.id) for robot in robots if robot.id != mission.robot_id}
    if fleet.obstacles and manifest.motion.dims == 3:
        refuse(fleet.path, "obstacle", "is a disc in the plane; the policy moves in space")
    plant = Plant(
        manifest.motion.at_period(mission.period_s),
        manifest.body.radius_m,
        [robot.start_m for robot in robots],
        fleet.obstacles,
        fleet.team.scale_m,
        [robot.start_heading_rad for robot in robots],
    )
    sensor = manifest.body.sensor() if fleet.obstacles else None
    return SimBridge(mission.robot_id, plant, tuple(robot.id for robot in robots), mates, sensor)
