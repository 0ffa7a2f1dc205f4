"""MAFPO with the ratio taken over the Euler chain itself, in place of eq. 8.

While exploring, each of the T Euler steps adds a little noise,

    a_(k+1) = a_k + v(a_k, k / T | o) / T + sigma z,   z ~ N(0, I),

so that the chain has an exact Gaussian density; its log-ratio is summed over the steps and limited by
PPO's clip. sigma is learned: training needs less of it as the policy gets better. The deployed policy adds
nothing. Related: DPPO, ReinFlow, Flow-GRPO.
"""

import math

import torch
from torch import Tensor, nn

from export.algorithms.base import TrainingSettings
from export.algorithms.networks import Actor, FlowNetwork
from export.algorithms.ppo import ClippedSurrogate
from export.algorithms.precision import half_precision


class NoisyFlow(Actor):
    """A flow, and the deviation of the noise that its chain explores with."""

    def __init__(self, observation_dim: int, action_dim: int, step_noise: float, prior_std: float) -> None:
        flow = FlowNetwork(observation_dim, action_dim, prior_std=prior_std)
        super().__init__(observation_dim, action_dim, flow.hidden, flow.activation)
        self.flow, self.moments = flow, flow.moments
        self.log_step_noise = nn.Parameter(torch.full((action_dim,), math.log(step_noise)))

    def as_flow(self) -> FlowNetwork:
        """The flow without the noise."""
        return self.flow


class MafpoChain(ClippedSurrogate):
    """A flow policy trained as a Markov chain of T small Gaussian steps."""

    name = "mafpo-chain"
    settings = TrainingSettings(learning_rate=1e-3, ratio_change=0.15)
    euler_steps = 10
    clip = 0.3
    """Wider than a Gaussian's, since a chain's ratio also moves where its last point does not."""
    step_noise = 0.15
    """sigma when training starts, in units of the action, at each Euler step."""
    prior_std = 0.5
    half_precision = True
    """Compute likelihoods in bfloat16 where the processor is faster so."""

    def __init__(self, observation_dim: int, action_dim: int) -> None:
        self.actor = NoisyFlow(observation_dim, action_dim, self.step_noise, self.prior_std)

    def explore(self, observation: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Sample noisy chains; the trace holds all T + 1 points."""
        shape = (self.euler_steps + 1, *observation.shape[:-1], self.actor.action_dim)
        noise = torch.randn(shape, generator=generator, device=observation.device)
        field, step_noise = self.actor.flow, self.actor.log_step_noise.exp()
        context, chain = field.context(observation), [noise[0]]
        for k in range(self.euler_steps):
            velocity = field.velocity(context, chain[-1], noise.new_full((1,), k / self.euler_steps))
            chain.append(chain[-1] + velocity / self.euler_steps + step_noise * noise[k + 1])
        return chain[-1], torch.stack(chain, -2).flatten(-2)

    def log_likelihood(self, observation: Tensor, action: Tensor, trace: Tensor) -> Tensor:
        """Log-density of the chain's T transitions, less its constant; the action is the chain's end."""
        chain = trace.unflatten(-1, (self.euler_steps + 1, action.shape[-1]))
        tau = torch.arange(self.euler_steps, device=chain.device)[:, None] / self.euler_steps
        field, log_step_noise = self.actor.flow, self.actor.log_step_noise
        with half_precision(chain.device, wanted=self.half_precision):
            context = field.context(observation)[..., None, :]
            velocity = field.velocity(context, chain[..., :-1, :], tau).float()
        residual = (chain.diff(dim=-2) - velocity / self.euler_steps) / log_step_noise.exp()
        return -(0.5 * residual.square() + log_step_noise).sum((-2, -1))

    def reflect_trace(self, trace: Tensor, signs: Tensor) -> Tensor:
        """All points of the chain are actions."""
        return trace * signs.repeat(self.euler_steps + 1)

    def act(self, observation: Tensor, start: Tensor) -> Tensor:
        """T Euler steps from ``start``, with no noise on the way."""
        return self.actor.flow.sample(observation, start, self.euler_steps)
