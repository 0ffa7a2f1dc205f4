"""VMAS Navigation: four discs drive to their own goals without touching each other.

Simulation and reward are those of VMAS 1.5.2. Episodes start by this module's own vectorised reset, which
draws from the same distribution, and robots see each other by `lidar.disc_ranges`, equal to VMAS's sensor.
"""

import dataclasses
from collections.abc import Sequence

import torch
from torch import Tensor
from vmas.scenarios.navigation import Scenario as VmasNavigation
from vmas.simulator.core import Agent

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import GoalOffset, Proximity
from export.scenarios.lidar import disc_ranges
from export.scenarios.scenario import EpisodeMetrics, ScenarioFacts, Transition
from export.scenarios.vmas_teams import FORCES, OWN_MOTION, State, VmasTeams, simulate

ROBOTS = 4
RADIUS_M = 0.1
GOAL_TOLERANCE_M = 0.1
ARENA_HALF_WIDTH_M = 1.0
SPAWN_DISTANCE_M = 2 * RADIUS_M + 0.05
"""Least distance between any two robots or goals when an episode starts."""

COLLISION_PENALTY = -3.0
PENALTY_GAP_M = 0.02
"""Gap between two discs below which both pay the penalty: wider than VMAS' 5 mm, to train with a margin."""
ARRIVAL_REWARD = 0.1
"""Paid to all in each step in which all stand on their goals: makes a parked robot give way to another."""
START_SPEED_M_S = 0.3
"""Training episodes start moving, up to this speed along each axis, so that the policy also knows
states that guidance leads to and that it would not enter by itself."""

FACTS = ScenarioFacts(
    name="navigation",
    robots=ROBOTS,
    observation=(*OWN_MOTION, GoalOffset("goal_offset", 2, "m"), Proximity("proximity", 12, "m")),
    action=FORCES,
    motion=PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),
    body=Body(radius_m=RADIUS_M, lidar_rays=12, lidar_range_m=0.35),
    training_steps=100,
    evaluation_steps=200,
    discount=0.97,
    failure="collision",
)
"""``goal_offset`` is position minus goal, ``proximity`` the sensor's range (0.35 m) minus its readings."""


class _SilentNavigation(VmasNavigation):
    """VMAS' scenario less its own observations: ``Navigation.observe`` makes those of all robots at once."""

    def observation(self, agent: Agent) -> Tensor:
        return agent.state.pos


class Navigation(VmasTeams):
    """B teams of VMAS Navigation.

    A team succeeds when all robots are within 0.1 m of their goals at the same time; it fails when the
    centres of two robots are at most two radii apart at the end of a control step.

    Args:
        environments: B.
        seed: of everything that is drawn.
        device: of all tensors.
        training: let episodes start in motion.
        robots: N, if not the training's; such a team's starts and goals find room in the arena, or drawing
            them never ends.
        half_width_m: of the arena.
        masses_kg: (N,), if not all 1.
    """

    facts = FACTS

    def __init__(
        self,
        environments: int,
        seed: int,
        device: torch.device,
        *,
        training: bool,
        robots: int = ROBOTS,
        half_width_m: float = ARENA_HALF_WIDTH_M,
        masses_kg: Sequence[float] = (),
    ) -> None:
        self.facts = dataclasses.replace(FACTS, robots=robots)
        self._half_width_m = half_width_m
        self._start_speed = START_SPEED_M_S if training else 0.0
        self._vmas = simulate(
            _SilentNavigation(),
            environments,
            seed,
            device,
            n_agents=robots,
            world_spawning_x=half_width_m,
            world_spawning_y=half_width_m,
            shared_rew=False,
            agent_collision_penalty=COLLISION_PENALTY,
            final_reward=ARRIVAL_REWARD,
        )
        self._vmas.scenario.min_collision_distance = PENALTY_GAP_M
        for agent, mass_kg in zip(self._vmas.agents, masses_kg, strict=False):
            agent.mass = mass_kg
        self._world = self._vmas.world
        super().__init__(environments, seed, device, self._vmas.agents)

    def observe(self) -> Tensor:
        """Return the observations (B, N, 18), fields in the order of ``FACTS``."""
        position, velocity = self.motion()
        offset = position - self._goals()
        proximity = FACTS.body.lidar_range_m - disc_ranges(position, FACTS.body)
        return torch.cat([position, velocity, offset, proximity], -1)

    def step(self, action: Tensor) -> Transition:
        """Apply forces (B, N, 2) in newtons, clamped to [-1, 1], for 0.1 s."""
        _, reward, arrived, _ = self._vmas.step(list(action.unbind(1)))
        return Transition(
            reward=torch.stack(reward, 1),
            succeeded=arrived,
            failed=self.closest() <= 2 * RADIUS_M,
            terminated=torch.zeros_like(arrived),
        )

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return the success rate."""
        return metrics.success

    def _starts(self, count: int) -> State:
        places, robots = self._spawn(count), self.facts.robots
        return {
            "position": places[:, :robots],
            "goal": places[:, robots:],
            "velocity": self._draw.uniform(count, robots, 2) * self._start_speed,
        }

    def _spawn(self, count: int) -> Tensor:
        """Draw starts, then goals, (count, 2 N, 2): each uniform where it is far enough from those before."""
        places = torch.empty(count, 2 * self.facts.robots, 2, device=self.device)
        for k in range(2 * self.facts.robots):
            todo = torch.arange(count, device=self.device)
            while len(todo):
                places[todo, k] = self._draw.uniform(len(todo), 2) * self._half_width_m
                distance = (places[todo, :k] - places[todo, k : k + 1]).norm(dim=-1)
                todo = todo[(distance < SPAWN_DISTANCE_M).any(1)]
        return places

    def _state(self) -> State:
        return {**super()._state(), "goal": self._goals()}

    def _goals(self) -> Tensor:
        return torch.stack([agent.goal.state.pos for agent in self._vmas.agents], 1)

    def _set_state(self, state: State) -> None:
        super()._set_state(state)
        distance = (state["position"] - state["goal"]).norm(dim=-1)
        for i, agent in enumerate(self._vmas.agents):
            agent.goal.state.pos = state["goal"][:, i].contiguous()
            agent.pos_shaping = distance[:, i].contiguous()
