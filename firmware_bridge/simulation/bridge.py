"""The bridge to a simulated team: the plant and the other robots run in this process."""

import argparse
import math
import time
from collections.abc import Callable, Mapping

from edge_runtime.common.closing import Closing
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command, RobotState, Teammate, TeamState, Vector2
from firmware_bridge.simulation.plant import Plant

REST: Vector2 = (0.0, 0.0)


class SimBridge(Closing):
    """One robot's link to a simulated team; also its `edge_runtime.team.membership.FleetLink`.

    Every read after the first one lets the whole team move for one period. The other robots decide on the
    states that this robot saw; a command moves this robot for one period only, and without one it coasts.

    Args:
        robot_id: the robot at this end of the link.
        plant: the team, in the order of ``ids``.
        ids: every robot's id.
        mates: the other robots' controllers by id.
        clock: monotonic time in seconds.
    """

    name = "sim"
    max_speed_m_s = math.inf
    complaints: tuple[str, ...] = ()
    reaction = None

    def __init__(
        self,
        robot_id: int,
        plant: Plant,
        ids: tuple[int, ...],
        mates: Mapping[int, Controller],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.robot_id = robot_id
        self.plant = plant
        self._ids, self._mates, self._clock = ids, mates, clock
        self._actions = dict.fromkeys(ids, REST)
        self._team: dict[int, Teammate] = {}

    def close(self) -> None:
        """Stop the robot."""
        self.stop("the link is closed")

    def read(self) -> RobotState:
        """Advance the team by one period, except the first time, and return the robot's state."""
        if self._team:
            self._advance()
        self._team = self._measure()
        self._actions[self.robot_id] = REST
        return self._team[self.robot_id].state

    def teammates(self) -> tuple[Teammate, ...]:
        """The other robots' states in the same instant, with the actions that they commanded last."""
        return self._others(self.robot_id)

    def write(self, command: Command) -> None:
        """Move the robot by this command during the next period."""
        self._actions[self.robot_id] = command.action

    def stop(self, reason: str) -> None:  # noqa: ARG002  # the simulated firmware keeps no log
        """Let the robot coast."""
        self._actions[self.robot_id] = REST

    def _advance(self) -> None:
        for robot_id, controller in self._mates.items():
            own = self._team[robot_id].state
            # These states are from this robot's last tick: fresh to whoever lives in simulated time.
            command = controller.decide(TeamState(own, self._others(robot_id)), own.stamp_s)
            self._actions[robot_id] = command.action
        self.plant.step([self._actions[robot_id] for robot_id in self._ids])

    def _measure(self) -> dict[int, Teammate]:
        now = self._clock()
        rows = zip(self._ids, self.plant.position_m.tolist(), self.plant.velocity_m_s.tolist(), strict=True)
        return {
            robot_id: Teammate(RobotState(robot_id, now, (x, y), (vx, vy)), self._actions[robot_id])
            for robot_id, (x, y), (vx, vy) in rows
        }

    def _others(self, robot_id: int) -> tuple[Teammate, ...]:
        return tuple(mate for other, mate in self._team.items() if other != robot_id)


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
    dynamics = manifest.dynamics.at_period(mission.period_s)
    plant = Plant(dynamics, manifest.body.radius_m, [robot.start_m for robot in robots])
    return SimBridge(mission.robot_id, plant, tuple(robot.id for robot in robots), mates)
