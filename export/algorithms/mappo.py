"""Multi-agent proximal policy optimisation (MAPPO, Yu et al. 2022): the paper's baseline policy.

All robots share one Gaussian actor that sees its own observation only; the advantages come from a
centralised critic (``export.training.trainer``). ``export.algorithms.gaussian`` says how its mean is
deployed.
"""

import torch
from torch import Tensor

from export.algorithms.base import TrainingSettings
from export.algorithms.gaussian import GaussianNetwork
from export.algorithms.ppo import ClippedSurrogate


class Mappo(ClippedSurrogate):
    """A Gaussian policy under PPO's clipped surrogate; its constants were chosen on VMAS Navigation."""

    name = "mappo"
    settings = TrainingSettings(learning_rate=1e-3)
    euler_steps = 1
    clip = 0.2

    def __init__(self, observation_dim: int, action_dim: int) -> None:
        self.actor = GaussianNetwork(observation_dim, action_dim)

    def explore(self, observation: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Sample actions; their densities need no trace."""
        policy = self.actor(observation)
        noise = torch.randn(policy.mean.shape, generator=generator, device=observation.device)
        return policy.mean + policy.stddev * noise, noise[..., :0]

    def log_likelihood(self, observation: Tensor, action: Tensor, trace: Tensor) -> Tensor:  # noqa: ARG002
        """Log-density of the actions."""
        return self.actor(observation).log_prob(action)

    def reflect_trace(self, trace: Tensor, signs: Tensor) -> Tensor:  # noqa: ARG002
        """There is nothing in it."""
        return trace

    def act(self, observation: Tensor, start: Tensor) -> Tensor:  # noqa: ARG002
        """The mean, wherever the flow would start."""
        return self.actor.mean(observation)
