"""Multi-agent proximal policy optimisation (MAPPO, Yu et al. 2022): the paper's baseline policy.

All robots share one Gaussian actor that sees its own observation only; the advantages come from a
centralised critic (``export.training.trainer``). ``export.algorithms.gaussian`` says how its mean is
deployed.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from export.algorithms.base import TrainingSettings
from export.algorithms.gaussian import GaussianNetwork


@dataclass(frozen=True)
class MappoSettings:
    """Constants of the algorithm, chosen on VMAS Navigation."""

    clip: float = 0.2
    """Half-width of the trust region."""
    entropy_bonus: float = 0.0
    """Weight of the actions' entropy in the objective, in nats."""
    initial_std: float = 0.5
    """Deviation of each action component when training starts, in units of the action."""


class Mappo:
    """A Gaussian policy under PPO's clipped surrogate."""

    name = "mappo"
    settings = TrainingSettings(learning_rate=1e-3)
    euler_steps = 1

    def __init__(self, observation_dim: int, action_dim: int) -> None:
        self.ppo = MappoSettings()
        self.actor = GaussianNetwork(observation_dim, action_dim, initial_std=self.ppo.initial_std)

    def explore(self, observation: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Sample actions; their densities need no trace."""
        policy = self.actor(observation)
        noise = torch.randn(policy.mean.shape, generator=generator, device=observation.device)
        return policy.mean + policy.stddev * noise, noise[..., :0]

    def log_likelihood(self, observation: Tensor, action: Tensor, trace: Tensor) -> Tensor:  # noqa: ARG002
        """Log-density of the actions."""
        return self.actor(observation).log_prob(action)

    def ratio(self, new: Tensor, old: Tensor) -> Tensor:
        """Ratio of the densities."""
        return (new - old).exp()

    def objective(self, ratio: Tensor, advantage: Tensor) -> Tensor:
        """The clipped surrogate and the entropy bonus, whose constant is left out."""
        clipped = ratio.clamp(1 - self.ppo.clip, 1 + self.ppo.clip)
        surrogate = torch.minimum(ratio * advantage, clipped * advantage)
        return surrogate + self.ppo.entropy_bonus * self.actor.log_deviation.sum()

    def act(self, observation: Tensor, start: Tensor) -> Tensor:  # noqa: ARG002
        """The mean, wherever the flow would start."""
        return self.actor.mean(observation)
