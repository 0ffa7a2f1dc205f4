"""Multi-agent flow policy optimisation (MAFPO): eqs. 3, 8 and 9 of the CFPG paper, top to bottom.

All robots share one flow actor that sees its own observation only; the ratio and the objective are
taken per robot, the advantages come from a centralised critic (``export.training.trainer``).
"""

import torch
from torch import Tensor

from export.algorithms.base import TrainingSettings
from export.algorithms.networks import FlowNetwork
from export.algorithms.precision import half_precision


def conditional_flow_matching_loss(
    actor: FlowNetwork,
    observation: Tensor,
    action: Tensor,
    noise: Tensor,
    tau: Tensor,
    *,
    terminal_weight: bool,
) -> Tensor:
    """Eq. 3 for given draws, summed over the action's components and averaged over the draws.

    Args:
        actor: the velocity field.
        observation: (R, O).
        action: (R, d), the sample at tau = 1.
        noise: (R, M, d), the samples at tau = 0.
        tau: (R, M, 1) in [0, 1].
        terminal_weight: weight each squared error by (1 - tau)^2.

    Returns:
        (R,)
    """
    target = action[:, None] - noise
    path = (1 - tau) * noise + tau * action[:, None]
    error = actor.velocity(actor.context(observation)[:, None], path, tau) - target
    if terminal_weight:
        error = error * (1 - tau)
    return error.square().sum(-1).mean(-1)


class Mafpo:
    """The paper's algorithm: eq. 8 takes a difference of flow-matching losses for a log-ratio.

    What the paper leaves open was chosen on VMAS Navigation.
    """

    name = "mafpo"
    settings = TrainingSettings(learning_rate=1e-3)
    euler_steps = 10
    noise_samples = 4
    """Draws of (noise, tau) that estimate the expectation of eq. 3."""
    spo_epsilon = 0.2
    """epsilon of eq. 9."""
    advantage_shift = 0.1
    """Added to the normalised advantages: without it the distribution hardly contracts."""
    log_ratio_limit = 3.0
    """Clamp of the loss difference before exp in eq. 8."""
    terminal_weight = True
    """Weight eq. 3 by (1 - tau)^2, which turns it into the error of the terminal estimate of eq. 10."""
    half_precision = True
    """Compute likelihoods in bfloat16 where the processor is faster so."""

    def __init__(self, observation_dim: int, action_dim: int) -> None:
        self.actor = FlowNetwork(observation_dim, action_dim)

    def explore(self, observation: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Sample actions, and the draws of (noise, tau) on which their loss will be compared."""
        start = torch.randn(
            (*observation.shape[:-1], self.actor.action_dim), generator=generator, device=observation.device
        )
        draws = (*observation.shape[:-1], self.noise_samples)
        noise = torch.randn((*draws, self.actor.action_dim), generator=generator, device=observation.device)
        tau = torch.rand((*draws, 1), generator=generator, device=observation.device)
        return self.act(observation, start), torch.cat([noise, tau], -1).flatten(-2)

    def log_likelihood(self, observation: Tensor, action: Tensor, trace: Tensor) -> Tensor:
        """The evidence bound that eq. 8 compares: minus the flow-matching loss on the stored draws."""
        draws = trace.unflatten(-1, (self.noise_samples, -1))
        noise, tau = draws[..., :-1], draws[..., -1:]
        with half_precision(trace.device, wanted=self.half_precision):
            return -conditional_flow_matching_loss(
                self.actor, observation, action, noise, tau, terminal_weight=self.terminal_weight
            )

    def reflect_trace(self, trace: Tensor, signs: Tensor) -> Tensor:
        """Noise is reflected, flow times stay."""
        return trace * torch.cat([signs, signs.new_ones(1)]).repeat(self.noise_samples)

    def ratio(self, new: Tensor, old: Tensor) -> Tensor:
        """Eq. 8, per robot."""
        limit = self.log_ratio_limit
        return (new - old).clamp(-limit, limit).exp()

    def objective(self, ratio: Tensor, advantage: Tensor) -> Tensor:
        """Eq. 9, per robot: simple policy optimisation."""
        advantage = advantage + self.advantage_shift
        return ratio * advantage - advantage.abs() / (2 * self.spo_epsilon) * (ratio - 1) ** 2

    def act(self, observation: Tensor, start: Tensor) -> Tensor:
        """T Euler steps from ``start``."""
        return self.actor.sample(observation, start, self.euler_steps)
