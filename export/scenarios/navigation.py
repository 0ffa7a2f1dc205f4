"""VMAS Navigation: four discs drive to their own goals without touching each other.

Simulation, reward and range sensor are those of VMAS 1.5.2; only episodes start by this module's own
vectorised reset, which draws from the same distribution.
"""

import contextlib
import io
from typing import Any

import torch
from torch import Tensor

from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.policy.manifest import ActionField, Body, ObservationField
from export.scenarios.scenario import EpisodeMetrics, ScenarioFacts, Transition

with contextlib.redirect_stderr(io.StringIO()):  # gym prints an advertisement for its successor
    import vmas

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
    observation=(
        ObservationField("position", 2, "m"),
        ObservationField("velocity", 2, "m/s"),
        ObservationField("goal_offset", 2, "m"),
        ObservationField("proximity", 12, "m"),
    ),
    action=(ActionField("force_x", "N", -1.0, 1.0), ActionField("force_y", "N", -1.0, 1.0)),
    dynamics=Dynamics(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),
    body=Body(radius_m=RADIUS_M, lidar_rays=12, lidar_range_m=0.35),
    training_steps=100,
    evaluation_steps=200,
    failure="collision",
)
"""``goal_offset`` is position minus goal, ``proximity`` the sensor's range (0.35 m) minus its readings."""


class Navigation:
    """B teams of VMAS Navigation.

    A team succeeds when all robots are within 0.1 m of their goals at the same time; it fails when the
    centres of two robots are at most two radii apart at the end of a control step.
    """

    facts = FACTS

    def __init__(self, environments: int, seed: int, device: torch.device, *, training: bool) -> None:
        self.environments = environments
        self.device = device
        self._start_speed = START_SPEED_M_S if training else 0.0
        self._generator = torch.Generator(device).manual_seed(seed)
        self._vmas = vmas.make_env(
            "navigation",
            num_envs=environments,
            device=device,
            continuous_actions=True,
            clamp_actions=True,
            seed=seed,
            n_agents=ROBOTS,
            shared_rew=False,
            agent_collision_penalty=COLLISION_PENALTY,
            final_reward=ARRIVAL_REWARD,
        )
        self._vmas.scenario.min_collision_distance = PENALTY_GAP_M
        self.reset()

    def observe(self) -> Tensor:
        """Return the observations (B, N, 18), fields in the order of ``FACTS``."""
        return torch.stack([self._vmas.scenario.observation(agent) for agent in self._vmas.agents], 1)

    def motion(self) -> tuple[Tensor, Tensor]:
        """Return the robots' positions (B, N, 2) in metres and velocities (B, N, 2) in m/s."""
        state = self._physical_state()
        return state["position"], state["velocity"]

    def step(self, action: Tensor) -> Transition:
        """Apply forces (B, N, 2) in newtons, clamped to [-1, 1], for 0.1 s."""
        _, reward, arrived, _ = self._vmas.step(list(action.unbind(1)))
        return Transition(
            reward=torch.stack(reward, 1),
            succeeded=arrived,
            failed=self._closest() <= 2 * RADIUS_M,
            terminated=torch.zeros_like(arrived),
        )

    def reset(self, finished: Tensor | None = None) -> None:
        """Start new episodes where ``finished`` (B,) is true; everywhere if it is None."""
        if finished is None:
            finished = torch.ones(self.environments, dtype=torch.bool, device=self.device)
        rows = finished.nonzero()[:, 0]
        places = self._spawn(len(rows))
        velocity = (2 * self._uniform(len(rows), ROBOTS, 2) - 1) * self._start_speed
        state = self._physical_state()
        state["position"][rows] = places[:, :ROBOTS]
        state["goal"][rows] = places[:, ROBOTS:]
        state["velocity"][rows] = velocity
        self._set_physical_state(state)

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return the success rate."""
        return metrics.success

    def state_dict(self) -> dict[str, Any]:
        """Return positions, velocities, goals and the generator."""
        return {**self._physical_state(), "generator": self._generator.get_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned."""
        self._set_physical_state(
            {name: state[name].to(self.device) for name in ("position", "velocity", "goal")}
        )
        self._generator.set_state(state["generator"])

    def _closest(self) -> Tensor:
        """Return the least distance between two robots' centres, (B,) in metres."""
        position = self._physical_state()["position"]
        first, second = torch.triu_indices(ROBOTS, ROBOTS, 1, device=self.device)
        return (position[:, first] - position[:, second]).norm(dim=-1).amin(1)

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self._generator, device=self.device)

    def _spawn(self, count: int) -> Tensor:
        """Draw starts, then goals, (count, 2 N, 2): each uniform where it is far enough from those before."""
        places = torch.empty(count, 2 * ROBOTS, 2, device=self.device)
        for k in range(2 * ROBOTS):
            todo = torch.arange(count, device=self.device)
            while len(todo):
                places[todo, k] = (2 * self._uniform(len(todo), 2) - 1) * ARENA_HALF_WIDTH_M
                distance = (places[todo, :k] - places[todo, k : k + 1]).norm(dim=-1)
                todo = todo[(distance < SPAWN_DISTANCE_M).any(1)]
        return places

    def _physical_state(self) -> dict[str, Tensor]:
        agents = self._vmas.agents
        return {
            "position": torch.stack([agent.state.pos for agent in agents], 1),
            "velocity": torch.stack([agent.state.vel for agent in agents], 1),
            "goal": torch.stack([agent.goal.state.pos for agent in agents], 1),
        }

    def _set_physical_state(self, state: dict[str, Tensor]) -> None:
        distance = (state["position"] - state["goal"]).norm(dim=-1)
        for i, agent in enumerate(self._vmas.agents):
            agent.state.pos = state["position"][:, i].contiguous()
            agent.state.vel = state["velocity"][:, i].contiguous()
            agent.goal.state.pos = state["goal"][:, i].contiguous()
            agent.pos_shaping = distance[:, i].contiguous()
