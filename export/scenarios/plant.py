"""The plant ``vmas``: a fleet's robots in VMAS's own physics, in the world of one of the training's tasks.

The fleet file says where robots, objects and goals are; what else there is, such as samples, its seed draws.
A tracked object is what the scenario's state calls by its name; a sensor, the field of its observation.
"""

from collections.abc import Sequence

import numpy as np
import torch

from edge_runtime.common.arrays import Floats
from edge_runtime.common.toml_file import refuse
from edge_runtime.config.fleet import Fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, Vector
from edge_runtime.motion.range_sensor import Disc
from edge_runtime.observation import Sensor
from export.scenarios import SCENARIOS, make_scenario
from export.scenarios.vmas_teams import State
from firmware_bridge.simulation.plants import Motion


class VmasPlant:
    """A team in VMAS, see `firmware_bridge.simulation.plants.TeamPlant`.

    Args:
        fleet: names the scenario.
        period_s: of a step; the training's where None.

    Raises:
        ConfigError: says what does not fit the scenario.
    """

    def __init__(self, fleet: Fleet, period_s: float | None = None) -> None:
        simulation = fleet.simulation
        if simulation.scenario not in SCENARIOS:
            found = "missing" if simulation.scenario is None else f"is {simulation.scenario!r}"
            allowed = ", ".join(sorted(SCENARIOS))
            refuse(fleet.path, "simulation.scenario", f"{found}; allowed: {allowed}")
        facts = SCENARIOS[simulation.scenario].facts
        if len(fleet.robots) != facts.robots:
            refuse(fleet.path, "robots", f"{len(fleet.robots)}; {facts.name} has {facts.robots}")
        if fleet.obstacles:
            refuse(fleet.path, "obstacle", "means nothing in VMAS; allowed with plant 'discs'")
        self.rate_hz, self._period_s = facts.control_rate_hz, period_s
        self._fleet, self._scale_m = fleet, fleet.team.scale_m
        self._make = lambda: make_scenario(
            facts.name, 1, simulation.seed, torch.device("cpu"), training=False
        )
        fields = {field.name: field for field in facts.observation}
        self.sensors = frozenset(name for name, field in fields.items() if isinstance(field, Sensor))
        ends = np.cumsum([field.size for field in facts.observation]).tolist()
        places = [slice(end - field.size, end) for field, end in zip(facts.observation, ends, strict=True)]
        self._slices = dict(zip(fields, places, strict=True))
        self.radius_m = facts.body.radius_m * self._scale_m
        self.touched: set[tuple[int, ...]] = set()
        self.reset()

    def reset(self) -> None:
        """Put everything where the fleet file has it."""
        torch.set_num_threads(1)
        self.world = self._make()
        if self._period_s:
            self.world.run_at(self._period_s)
        state = self.world.state_dict()
        state["position"] = self._policy_metres([robot.start_m for robot in self._fleet.robots])
        for index, each in enumerate(self._fleet.tracked):
            if each.name not in state:
                known = ", ".join(
                    name.removesuffix("_velocity") for name in state if name.endswith("_velocity")
                )
                what = f"{each.name!r} is nothing that this scenario moves; allowed: {known or 'none'}"
                refuse(self._fleet.path, f"tracked[{index}].name", what)
            state[each.name] = self._policy_metres(each.start_m)
            if each.goal_m:
                state["goal"] = self._policy_metres(each.goal_m)
        goals = [robot.goal_m for robot in self._fleet.robots if robot.goal_m]
        if goals and "goal" in state:
            state["goal"] = self._policy_metres(goals)
        self.world.load_state_dict(state)
        self.touched.clear()
        self._look()

    def drive(self, commands: Sequence[Command]) -> None:
        """Advance by one control period."""
        self.push([command.action for command in commands])

    def push(self, actions: Sequence[Sequence[float]]) -> None:
        """Advance by one step under the policy's actions."""
        self.transition = self.world.step(torch.tensor([list(map(list, actions))], dtype=torch.float32))
        self._look()

    def motions(self) -> Sequence[Motion]:
        """The robots', in order."""
        position, velocity = self._rows("position"), self._rows("velocity")
        return [Motion(tuple(p), tuple(v)) for p, v in zip(position.tolist(), velocity.tolist(), strict=True)]

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', in the fleet file's order."""
        return [self._object(each.name) for each in self._fleet.tracked]

    def obstacles(self) -> Sequence[Disc]:
        """None."""
        return ()

    def reading(self, robot: int, sensor: str) -> Vector:
        """What the scenario lets a robot observe under the sensor's name."""
        return tuple(self._observed[robot, self._slices[sensor]].tolist())

    def _object(self, name: str) -> Motion:
        place, velocity = self._rows(name), self._rows(f"{name}_velocity")
        heading, rate = (self._state.get(f"{name}_{what}") for what in ("angle", "angular_velocity"))
        turn = [0.0 if number is None else float(number.flatten()[0]) for number in (heading, rate)]
        return Motion(tuple(place.tolist()), tuple(velocity.tolist()), *turn)

    def _look(self) -> None:
        self._state: State = self.world.state_dict()
        self._observed = self.world.observe()[0].double().numpy()
        places = self._rows("position")
        apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
        near = np.argwhere(np.triu(apart <= 2.0 * self.radius_m, 1))
        self.touched.update((int(i), int(j)) for i, j in near)

    def _rows(self, name: str) -> Floats:
        """What the one team's state calls by this name, in the robots' metres."""
        rows: Floats = self._state[name][0].double().numpy() * self._scale_m
        return rows

    def _policy_metres(self, places: object) -> torch.Tensor:
        return torch.tensor(np.array([places], np.float32) / self._scale_m, dtype=torch.float32)


def make_plant(mission: Mission) -> VmasPlant:
    """Simulate a mission's fleet.

    Raises:
        ConfigError: as `VmasPlant`, or if the mission runs at another rate than the training.
    """
    plant = VmasPlant(mission.fleet)
    if abs(mission.rate_hz - plant.rate_hz) > 1e-9:
        raise ConfigError(f"--rate {mission.rate_hz:g}: VMAS steps at {plant.rate_hz:g} Hz")
    return plant
