"""What the scenarios share: VMAS itself, the robots' motion as tensors, and how episodes begin anew."""

from typing import Any

import torch
from torch import Tensor
from vmas import make_env
from vmas.simulator.core import Agent, World
from vmas.simulator.environment import Environment
from vmas.simulator.scenario import BaseScenario

from edge_runtime.observation import Position, Velocity
from edge_runtime.policy.manifest import ActionField
from export.scenarios.scenario import ScenarioFacts

State = dict[str, Tensor]
"""What decides an episode's future besides chance, by name; the first dimension is that of the B teams."""

FORCES = (ActionField("force_x", "N", -1.0, 1.0), ActionField("force_y", "N", -1.0, 1.0))
OWN_MOTION = (Position("position", 2, "m"), Velocity("velocity", 2, "m/s"))
"""What every robot observes first."""


def simulate(
    scenario: BaseScenario | str, environments: int, seed: int, device: torch.device, **options: float
) -> Environment:
    """Let VMAS simulate B = ``environments`` teams of one of its scenarios."""
    return make_env(
        scenario,
        num_envs=environments,
        seed=seed,
        device=device,
        continuous_actions=True,
        clamp_actions=True,
        **options,
    )


class Draw:
    """Uniform numbers from one generator, on its device."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator = generator

    def uniform(self, *shape: int, low: float = -1.0, high: float = 1.0) -> Tensor:
        """Draw from [low, high)."""
        sample = torch.rand(shape, generator=self.generator, device=self.generator.device)
        return sample * (high - low) + low


class VmasTeams:
    """B teams that VMAS moves; a task adds its state and starts, what is observed, and what a step brings.

    Args:
        environments: B.
        seed: of everything that is drawn.
        device: of all tensors.
        agents: VMAS' robots; their episodes begin at once.
    """

    facts: ScenarioFacts
    _world: World
    """VMAS's, which a task makes before this class's own part."""

    def __init__(self, environments: int, seed: int, device: torch.device, agents: list[Agent]) -> None:
        self.environments, self.device = environments, device
        self._agents = agents
        self._draw = Draw(torch.Generator(device).manual_seed(seed))
        self.reset(torch.ones(environments, dtype=torch.bool, device=device))

    def run_at(self, period_s: float) -> None:
        """Let each step from here on last so long: drag is compounded."""
        world = self._world
        world._drag = 1.0 - (1.0 - world._drag) ** (period_s / world._dt)
        world._dt, world._sub_dt = period_s, period_s / world._substeps

    def motion(self) -> tuple[Tensor, Tensor]:
        """Return the robots' positions (B, N, 2) in metres and velocities (B, N, 2) in m/s."""
        states = [agent.state for agent in self._agents]
        return torch.stack([state.pos for state in states], 1), torch.stack([s.vel for s in states], 1)

    def closest(self) -> Tensor:
        """Return the least distance between two robots' centres, (B,) in metres."""
        position, _ = self.motion()
        first, second = torch.triu_indices(len(self._agents), len(self._agents), 1, device=self.device)
        return (position[:, first] - position[:, second]).norm(dim=-1).amin(1)

    def reset(self, finished: Tensor) -> None:
        """Start new episodes where ``finished`` (B,) is true."""
        rows, state = finished.nonzero()[:, 0], self._state()
        for name, start in self._starts(len(rows)).items():
            state[name][rows] = start
        self._set_state(state)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of all teams and the generator's."""
        return {**self._state(), "generator": self._draw.generator.get_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned."""
        self._set_state({name: state[name].to(self.device) for name in self._state()})
        self._draw.generator.set_state(state["generator"])

    def _starts(self, count: int) -> State:
        """Draw the starts of ``count`` episodes."""
        raise NotImplementedError

    def _state(self) -> State:
        """Return new tensors: the robots' ``position`` and ``velocity`` (B, N, 2), and the task's own."""
        position, velocity = self.motion()
        return {"position": position, "velocity": velocity}

    def _set_state(self, state: State) -> None:
        for i, agent in enumerate(self._agents):
            agent.state.pos = state["position"][:, i].contiguous()
            agent.state.vel = state["velocity"][:, i].contiguous()
