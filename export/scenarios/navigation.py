"""VMAS Navigation: four discs drive to their own goals without touching each other.

Simulation, reward and range sensor are those of VMAS 1.5.2; only episodes start by this module's own
vectorised reset, which draws from the same distribution.
"""

import torch
from torch import Tensor

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import GoalOffset, Proximity
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
    failure="collision",
)
"""``goal_offset`` is position minus goal, ``proximity`` the sensor's range (0.35 m) minus its readings."""


class Navigation(VmasTeams):
    """B teams of VMAS Navigation.

    A team succeeds when all robots are within 0.1 m of their goals at the same time; it fails when the
    centres of two robots are at most two radii apart at the end of a control step.
    """

    facts = FACTS

    def __init__(self, environments: int, seed: int, device: torch.device, *, training: bool) -> None:
        self._start_speed = START_SPEED_M_S if training else 0.0
        self._vmas = simulate(
            "navigation",
            environments,
            seed,
            device,
            n_agents=ROBOTS,
            shared_rew=False,
            agent_collision_penalty=COLLISION_PENALTY,
            final_reward=ARRIVAL_REWARD,
        )
        self._vmas.scenario.min_collision_distance = PENALTY_GAP_M
        self._world = self._vmas.world
        super().__init__(environments, seed, device, self._vmas.agents)

    def observe(self) -> Tensor:
        """Return the observations (B, N, 18), fields in the order of ``FACTS``."""
        return torch.stack([self._vmas.scenario.observation(agent) for agent in self._vmas.agents], 1)

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
        places = self._spawn(count)
        return {
            "position": places[:, :ROBOTS],
            "goal": places[:, ROBOTS:],
            "velocity": self._draw.uniform(count, ROBOTS, 2) * self._start_speed,
        }

    def _spawn(self, count: int) -> Tensor:
        """Draw starts, then goals, (count, 2 N, 2): each uniform where it is far enough from those before."""
        places = torch.empty(count, 2 * ROBOTS, 2, device=self.device)
        for k in range(2 * ROBOTS):
            todo = torch.arange(count, device=self.device)
            while len(todo):
                places[todo, k] = self._draw.uniform(len(todo), 2) * ARENA_HALF_WIDTH_M
                distance = (places[todo, :k] - places[todo, k : k + 1]).norm(dim=-1)
                todo = todo[(distance < SPAWN_DISTANCE_M).any(1)]
        return places

    def _state(self) -> State:
        goal = torch.stack([agent.goal.state.pos for agent in self._vmas.agents], 1)
        return {**super()._state(), "goal": goal}

    def _set_state(self, state: State) -> None:
        super()._set_state(state)
        distance = (state["position"] - state["goal"]).norm(dim=-1)
        for i, agent in enumerate(self._vmas.agents):
            agent.goal.state.pos = state["goal"][:, i].contiguous()
            agent.pos_shaping = distance[:, i].contiguous()
