"""A Gaussian policy, and how the runtime of flow policies deploys its mean.

The mean mu(o) is a flow that takes a single Euler step from zero: with T = 1 and v(a, 0 | o) = mu(o) the
action is 0 + v(0, 0 | o) = mu(o). As a `FlowNetwork` this has no prior field, and the action's and time's
rows of its first layer are zero.
"""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.distributions import Independent, Normal

from export.algorithms.networks import ACTIVATIONS, Actor, FlowNetwork

INITIAL_DEVIATION = 0.5
"""Of each action component when training starts, in units of the action."""


class GaussianNetwork(Actor):
    """N(mu(o), diag(s^2)): an MLP's mean and a learned deviation that no observation changes."""

    start = "zero"

    def __init__(self, observation_dim: int, action_dim: int) -> None:
        super().__init__(observation_dim, action_dim, (64, 64), "silu")
        self.from_observation = nn.Linear(observation_dim, self.hidden[0])
        self.layers = nn.ModuleList(nn.Linear(m, n) for m, n in pairwise((*self.hidden, action_dim)))
        self.log_deviation = nn.Parameter(torch.full((action_dim,), math.log(INITIAL_DEVIATION)))
        self._activate = ACTIVATIONS[self.activation]()
        nn.init.normal_(self.layers[-1].weight, std=0.01)
        nn.init.zeros_(self.layers[-1].bias)

    def mean(self, observation: Tensor) -> Tensor:
        """mu: observations (.., O) -> (.., d)."""
        x = self.from_observation(self.moments(observation))
        for layer in self.layers:
            x = layer(self._activate(x))
        return x

    def forward(self, observation: Tensor) -> Independent:
        """Distribution of the actions (.., d), given observations (.., O)."""
        # Not checked in torch: whether it makes sense is asked once an update, in one line.
        normal = Normal(self.mean(observation), self.log_deviation.exp(), validate_args=False)
        return Independent(normal, 1, validate_args=False)

    def as_flow(self) -> FlowNetwork:
        """Return the flow whose single Euler step from zero is the mean."""
        flow = FlowNetwork(
            self.observation_dim, self.action_dim, self.hidden, self.activation, prior_std=None
        )
        for name in ("moments", "from_observation", "layers"):
            getattr(flow, name).load_state_dict(getattr(self, name).state_dict())
        nn.init.zeros_(flow.from_action.weight)
        nn.init.zeros_(flow.from_time.weight)
        return flow
