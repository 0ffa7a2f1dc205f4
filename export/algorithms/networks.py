"""Networks of training: the flow actor of ``edge_runtime.policy.weights``, and a centralised critic."""

import math
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from edge_runtime.policy.manifest import FlowStart
from edge_runtime.policy.weights import Activation, FlowWeights
from export.algorithms.moments import RunningMoments

ACTIVATIONS: dict[Activation, type[nn.Module]] = {"silu": nn.SiLU, "tanh": nn.Tanh}
TIME_FREQUENCIES = (1.0, 2.0, 4.0, 8.0)
"""Radians per unit of flow time; each is used once as a sine and once as a cosine."""


class Actor(nn.Module):
    """What training needs of a policy's network, whatever the distribution of its actions."""

    start: FlowStart = "noise"
    """What ``as_flow()`` starts from."""

    def __init__(
        self, observation_dim: int, action_dim: int, hidden: tuple[int, ...], activation: Activation
    ) -> None:
        super().__init__()
        self.observation_dim, self.action_dim = observation_dim, action_dim
        self.hidden, self.activation = hidden, activation
        self.moments = RunningMoments(observation_dim)

    def as_flow(self) -> "FlowNetwork":
        """Return the flow that robots run in this policy's stead."""
        raise NotImplementedError(f"{type(self).__name__} must define as_flow()")


class FlowNetwork(Actor):
    """Velocity field v(a, tau | o), see ``edge_runtime.policy.weights``; observations are normalised here.

    The first layer is a sum of an observation, an action and a time part, so that one observation's part
    serves any number of noise samples and flow times.
    """

    frequency: Tensor
    phase: Tensor

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        hidden: tuple[int, ...] = (64, 64),
        activation: Activation = "silu",
        prior_std: float | None = 0.5,
    ) -> None:
        super().__init__(observation_dim, action_dim, hidden, activation)
        self.prior_std = prior_std
        self.register_buffer("frequency", torch.tensor(TIME_FREQUENCIES).repeat(2))
        self.register_buffer(
            "phase", torch.tensor([0.0, math.pi / 2]).repeat_interleave(len(TIME_FREQUENCIES))
        )
        self.from_observation = nn.Linear(observation_dim, hidden[0])
        self.from_action = nn.Linear(action_dim, hidden[0], bias=False)
        self.from_time = nn.Linear(1 + len(self.frequency), hidden[0], bias=False)
        self.layers = nn.ModuleList(nn.Linear(m, n) for m, n in pairwise((*hidden, action_dim)))
        self._activate = ACTIVATIONS[activation]()
        # Training starts from the prior field alone: a Gaussian of deviation ``prior_std``.
        nn.init.normal_(self.layers[-1].weight, std=0.01)
        nn.init.zeros_(self.layers[-1].bias)

    def context(self, observation: Tensor) -> Tensor:
        """Observations (.., O) -> their part of the first layer (.., H1)."""
        return self.from_observation(self.moments(observation))

    def velocity(self, context: Tensor, action: Tensor, tau: Tensor) -> Tensor:
        """v of actions (.., d) at flow times (.., 1), given contexts (.., H1); all broadcast."""
        time = torch.cat([tau, torch.sin(tau * self.frequency + self.phase)], -1)
        x = self._activate(context + self.from_action(action) + self.from_time(time))
        for layer in self.layers[:-1]:
            x = self._activate(layer(x))
        return self.layers[-1](x) + self.prior_gain(tau) * action

    def forward(self, action: Tensor, tau: Tensor, observation: Tensor) -> Tensor:
        """v of actions (.., d) at flow times (.., 1), given observations (.., O)."""
        return self.velocity(self.context(observation), action, tau)

    def sample(self, observation: Tensor, start: Tensor, steps: int) -> Tensor:
        """Integrate from ``start`` (.., d) at tau = 0 to the action at tau = 1 by Euler steps."""
        context, action = self.context(observation), start
        for k in range(steps):
            action = action + self.velocity(context, action, start.new_full((1,), k / steps)) / steps
        return action

    def as_flow(self) -> "FlowNetwork":
        """Return itself."""
        return self

    def to_weights(self) -> FlowWeights:
        """Copy the weights in the runtime's layout, the observations' normalisation folded in."""
        deviation, mean = self.moments.deviation.cpu().numpy(), self.moments.mean.cpu().numpy()
        observation = _transposed(self.from_observation) / deviation[:, None]
        bias = _float64(self.from_observation.bias) - mean @ observation
        return FlowWeights(
            activation=self.activation,
            action=_transposed(self.from_action).astype(np.float32),
            observation=observation.astype(np.float32),
            time=_transposed(self.from_time).astype(np.float32),
            time_frequency=self.frequency.cpu().numpy(),
            time_phase=self.phase.cpu().numpy(),
            matrices=tuple(_transposed(layer).astype(np.float32) for layer in self.layers),
            biases=tuple(b.astype(np.float32) for b in (bias, *(_float64(m.bias) for m in self.layers))),
            prior_std=self.prior_std,
        )

    def prior_gain(self, tau: Tensor) -> Tensor | float:
        """k(tau) of the prior field."""
        if self.prior_std is None:
            return 0.0
        variance = self.prior_std**2
        return (tau * variance - (1 - tau)) / ((1 - tau) ** 2 + tau**2 * variance)


class Critic(nn.Module):
    """Value of every robot's situation, seen from everywhere: all observations, its own first."""

    def __init__(self, observation_dim: int, robots: int, hidden: tuple[int, ...] = (64, 64)) -> None:
        super().__init__()
        widths = (observation_dim * robots, *hidden)
        layers = [m for a, b in pairwise(widths) for m in (nn.Linear(a, b), nn.SiLU())]
        self.layers = nn.Sequential(*layers, nn.Linear(hidden[-1], 1))
        nn.init.zeros_(self.layers[-1].bias)

    def forward(self, observation: Tensor) -> Tensor:
        """Normalised observations (.., N, O) -> values (.., N)."""
        return self.own_value(team_views(observation))

    def own_value(self, views: Tensor) -> Tensor:
        """Views (.., N O) of one robot each -> values (..,)."""
        return self.layers(views)[..., 0]


def team_views(observation: Tensor) -> Tensor:
    """Observations (.., N, O) -> (.., N, N O): all of them as each robot sees them, its own first."""
    robots = observation.shape[-2]
    return torch.cat([observation.roll(-k, -2) for k in range(robots)], -1)


def _float64(tensor: Tensor) -> np.ndarray:
    return tensor.detach().cpu().double().numpy()


def _transposed(layer: nn.Linear) -> np.ndarray:
    return _float64(layer.weight).T
