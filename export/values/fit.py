"""Fitting what actions are worth: guided teams explore around a policy, and advantages are regressed."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from edge_runtime.policy.bundle import Bundle
from export.algorithms.gae import advantages
from export.algorithms.networks import Critic, team_views
from export.common.distributed import CPU
from export.evaluation.guidance import unguided_actions
from export.scenarios import make_scenario
from export.values.action_value import ActionValue
from export.values.guided_teams import GuidedTeams

TEAMS = 512
EPISODES = 2
"""Of each team."""
NOISE = 0.25
"""Deviation of the exploration around the policy's actions, in units of the action."""
ROUNDS = 6
"""Of the critic after its own estimates."""
GAE_LAMBDA = 0.9
EPOCHS = 6
WIDTH = 64
BATCH = 8192
LEARNING_RATE = 2e-3
FLOOR = 1e-3
"""Least deviation that an observed number is divided by."""


class _Explored(NamedTuple):
    """K control steps of B teams of N robots."""

    observation: Tensor
    """(K, B, N, O)"""
    action: Tensor
    """(K, B, N, d), as corrected."""
    reward: Tensor
    """(K, B, N)"""
    done: Tensor
    """(K, B)"""
    last: Tensor
    """(K, B, N, O), seen after each step, before a new episode."""


def fit_value(bundle: Bundle, scenario: str, policy: str, seed: int, teams: int = TEAMS) -> ActionValue:
    """Fit what a trained policy's robots gain by other actions than its own.

    Args:
        bundle: the policy.
        scenario: its task.
        policy: its digest.
        seed: of starts, exploration and minibatches.
        teams: that explore side by side.
    """
    torch.manual_seed(seed)
    world = GuidedTeams(make_scenario(scenario, teams, seed, CPU, training=True), seed)
    seen = _explore(bundle, world, seed)
    mean, deviation = seen.observation.mean((0, 1, 2)), seen.observation.std((0, 1, 2)).clamp_min(FLOOR)
    seen = seen._replace(
        observation=(seen.observation - mean) / deviation,
        last=(seen.last - mean) / deviation,
        reward=seen.reward / seen.reward.std().clamp_min(1e-6),
    )
    advantage = _advantages(seen, world.facts.discount).flatten()
    advantage = (advantage - advantage.mean()) / advantage.std()
    given = torch.cat([seen.observation, seen.action], -1).flatten(0, 2)
    widths = (given.shape[1], WIDTH, WIDTH)
    hidden = [layer for a, b in pairwise(widths) for layer in (nn.Linear(a, b), nn.SiLU())]
    network = nn.Sequential(*hidden, nn.Linear(WIDTH, 1))
    _regress(network, given, advantage, EPOCHS)
    return exported(network, mean, deviation, policy)


@torch.no_grad()
def _explore(bundle: Bundle, world: GuidedTeams, seed: int) -> _Explored:
    facts, draw = world.facts, np.random.default_rng(seed)
    shape = (world.environments, facts.robots, facts.action_dim)
    field, rows = bundle.policy(shape[0] * shape[1]), []
    for _ in range(EPISODES):
        for step in range(facts.training_steps):
            observation = world.observe()
            start = draw.standard_normal((shape[0] * shape[1], shape[2]))
            action = unguided_actions(field, observation.flatten(0, 1).numpy(), start)
            action += NOISE * draw.standard_normal(action.shape)
            transition = world.step(torch.from_numpy(action.reshape(shape)).float())
            over = transition.terminated | (step == facts.training_steps - 1)
            taken, after = torch.from_numpy(world.commanded).float(), world.observe()
            rows.append((observation, taken, transition.reward.clone(), transition.terminated, after))
            if over.any():
                world.reset(over)
    return _Explored(*map(torch.stack, zip(*rows, strict=True)))


def _advantages(seen: _Explored, discount: float) -> Tensor:
    """Estimate them (K, B, N) by a critic that is fitted on the way."""
    steps = len(seen.reward) // EPISODES
    critic = Critic(seen.observation.shape[-1], seen.observation.shape[2])
    views = team_views(seen.observation).flatten(0, 2)
    cut = torch.zeros_like(seen.done)
    cut[steps - 1 :: steps] = True
    beyond = (cut & ~seen.done)[..., None]
    for _ in range(ROUNDS):
        value, after = (_values(critic, each) for each in (seen.observation, seen.last))
        reward = seen.reward + discount * torch.where(beyond, after, torch.zeros(()))
        found = advantages(
            reward, value, after[-1], seen.done | cut, discount=discount, gae_lambda=GAE_LAMBDA
        )
        _regress(critic.layers, views, (found + value).flatten(), 2)
    return found


@torch.no_grad()
def _values(critic: Critic, observation: Tensor) -> Tensor:
    return torch.stack([critic(each) for each in observation])


def _regress(network: nn.Module, given: Tensor, wanted: Tensor, epochs: int) -> None:
    """Least squares, at a rate that falls to zero."""
    optimizer = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=1e-3)
    batches = epochs * -(-len(given) // BATCH)
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.02, batches)
    for _ in range(epochs):
        for rows in torch.randperm(len(given)).split(BATCH):
            loss = (network(given[rows])[:, 0] - wanted[rows]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()


def exported(network: nn.Sequential, mean: Tensor, deviation: Tensor, policy: str) -> ActionValue:
    """The network, what normalises its observations folded into it."""
    first, second, last = (layer for layer in network if isinstance(layer, nn.Linear))
    size = len(mean)
    weight, bias = (parameter.detach().double() for parameter in (first.weight, first.bias))
    observation = weight[:, :size].T / deviation.double()[:, None]
    return ActionValue(
        policy,
        *(
            values.detach().float().numpy()
            for values in (
                observation,
                weight[:, size:].T,
                bias - mean.double() @ observation,
                second.weight.T,
                second.bias,
                last.weight[0],
            )
        ),
    )
