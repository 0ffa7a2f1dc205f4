"""Where `export.algorithms.mafpo_warm` begins: a trained Gaussian policy, and what it sees when it drives."""

from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from edge_runtime.errors import ConfigError
from export.algorithms.mafpo_warm import DEVIATION, match
from export.algorithms.networks import FlowNetwork
from export.scenarios import make_scenario
from export.training.checkpoint import load_policy

ENVIRONMENTS = 256
EVERY = 4
"""Control steps between two that are learned from: neighbouring ones tell the same."""


def warm_start(flow: FlowNetwork, scenario: str, run: Path, seed: int) -> float:
    """Make a new flow equal to the Gaussian policy that a run trained; returns how well it matches.

    Raises:
        ConfigError: if the run holds no Gaussian policy for this scenario.
    """
    gaussian, facts = load_policy(run)
    if facts.scenario != scenario or facts.start != "zero" or facts.preferred:
        raise ConfigError(
            f"{run} holds {facts.algorithm} on {facts.scenario}, no Gaussian policy for {scenario}: name the "
            f"--out directory of edge-train {scenario} --algorithm mappo"
        )
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
