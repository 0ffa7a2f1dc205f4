"""Where `export.algorithms.mafpo_warm` begins: a trained Gaussian policy, and what it sees when it drives."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from edge_runtime.errors import ConfigError
from export.algorithms.mafpo_warm import DEVIATION, match
from export.algorithms.moments import RunningMoments
from export.algorithms.networks import Critic, FlowNetwork
from export.scenarios import make_scenario, scenario_facts
from export.scenarios.scenario import ScenarioFacts
from export.training.checkpoint import CHECKPOINT, load, load_policy, taken_from
from export.training.fitted import fitted, require_finite

ENVIRONMENTS = 256
EVERY = 4
"""Control steps between two that are learned from: neighbouring ones tell the same."""


@dataclass(frozen=True)
class WarmStart:
    """What a run of a Gaussian policy leaves to a new flow."""

    gaussian: FlowNetwork
    """Its policy."""
    trainer: dict[str, dict[str, Tensor]]
    """Its critic and scale of rewards: ``critic`` and ``reward_moments`` of `Trainer.state_dict`."""


def load_warm_start(run: Path, scenario: str) -> WarmStart:
    """Read a run of a Gaussian policy.

    Raises:
        ConfigError: if it holds none for this scenario, or no critic of it.
    """
    gaussian, facts = load_policy(run)
    if facts.scenario != scenario or facts.start != "zero" or facts.preferred:
        raise ConfigError(
            f"{run} holds {facts.algorithm} on {facts.scenario}, no Gaussian policy for {scenario}: name the "
            f"--out directory of edge-train {scenario} --algorithm mappo"
        )
    path = run / CHECKPOINT
    saved = load(path)
    with taken_from(path, "run"):
        return WarmStart(gaussian, _critic(saved["trainer"], scenario_facts(scenario)))


def _critic(found: dict[str, Any], spaces: ScenarioFacts) -> dict[str, dict[str, Tensor]]:
    critic = Critic(spaces.observation_dim, spaces.robots)
    own = {"critic": critic.state_dict(), "reward_moments": RunningMoments(1).state_dict()}
    taken: dict[str, dict[str, Tensor]] = {name: fitted(found[name], own[name]) for name in own}
    critic.load_state_dict(taken["critic"])
    require_finite(critic(torch.ones(spaces.robots, spaces.observation_dim)))
    return taken


def warm_start(flow: FlowNetwork, gaussian: FlowNetwork, scenario: str, seed: int) -> float:
    """Make a new flow equal to a Gaussian policy; returns how well it matches."""
    flow.moments.load_state_dict(gaussian.moments.state_dict())
    generator = torch.Generator(flow.from_observation.weight.device).manual_seed(seed)

    def mean(observation: Tensor) -> Tensor:
        return gaussian.sample(observation, observation.new_zeros(*observation.shape[:-1], 2), 1)

    return match(flow, mean, _drive(scenario, mean, generator, seed), generator)


@torch.no_grad()
def _drive(scenario: str, mean: Callable[[Tensor], Tensor], generator: torch.Generator, seed: int) -> Tensor:
    """Observations (R, O) of training episodes in which the policy explores."""
    world = make_scenario(scenario, ENVIRONMENTS, seed, generator.device, training=True)
    seen = []
    for step in range(world.facts.training_steps):
        observation = world.observe()
        if step % EVERY == 0:
            seen.append(observation.flatten(0, 1))
        action = mean(observation)
        noise = torch.randn(action.shape, generator=generator, device=action.device)
        transition = world.step(action + DEVIATION * noise)
        if transition.terminated.any():
            world.reset(transition.terminated)
    return torch.cat(seen)
