"""MAFPO from a warm start: a Gaussian policy first, then its flow.

A flow learns a hard task more slowly than a Gaussian policy (`export.algorithms.mappo`), and what it
learns answers more stiffly to being pushed about. Here the flow begins as that policy: for actions
N(mu(o), s^2 I) the optimal transport path has the velocity

    v(a, tau | o) = k(tau) a + (1 - tau k(tau)) mu(o),

k being the prior field's gain of `export.algorithms.networks` with s its deviation. The flow is regressed on
it where
the Gaussian policy drives, and goes on learning by itself as `mafpo-chain` does, with that policy's critic.
"""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from export.algorithms.base import TrainingSettings
from export.algorithms.mafpo_chain import MafpoChain
from export.algorithms.networks import FlowNetwork

DEVIATION = 0.2
"""s, about what a Gaussian policy explores with in the end. With 0.1 the flow by itself is no better, and
follows guidance less."""
MATCHING_STEPS = 10_000
BATCH = 4096
LEARNING_RATE = 3e-3


class MafpoWarm(MafpoChain):
    """`mafpo-chain`, gently, from a flow that matches a trained Gaussian policy."""

    name = "mafpo-warm"
    settings = TrainingSettings(
        frames=400_000,
        learning_rate=3e-4,
        ratio_change=0.08,
        validation_every=8,
        guided_from=0.0,
        moving_moments=False,
    )
    clip = 0.2
    step_noise = 0.06
    prior_std = DEVIATION


def match(
    flow: FlowNetwork,
    mean: Callable[[Tensor], Tensor],
    observation: Tensor,
    generator: torch.Generator,
    steps: int = MATCHING_STEPS,
) -> float:
    """Regress a flow on the velocity of N(mean(o), s^2 I), s its prior's deviation.

    Args:
        flow: trained in place; its observation moments are left alone.
        mean: observations (R, O) -> actions (R, d).
        observation: (R, O), where to match.
        generator: of minibatches, noise and flow times.
        steps: of gradient descent.

    Returns:
        The root mean square error of the sampled action's mean over the last tenth, in units of the action.
    """
    if flow.prior_std is None:
        raise ValueError("a flow without a prior field has no deviation to match")
    optimizer = torch.optim.Adam(flow.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    with torch.no_grad():
        target = mean(observation)
    errors: list[Tensor] = []
    for _ in range(steps):
        rows = torch.randint(len(observation), (BATCH,), generator=generator, device=observation.device)
        tau = torch.rand((BATCH, 1), generator=generator, device=observation.device)
        noise = torch.randn((BATCH, target.shape[1]), generator=generator, device=observation.device)
        wanted, gain = target[rows], flow.prior_gain(tau)
        spread = ((1 - tau) ** 2 + (tau * flow.prior_std) ** 2).sqrt()
        action = tau * wanted + spread * noise
        error = flow(action, tau, observation[rows]) - gain * action - (1 - tau * gain) * wanted
        # Near tau = 1 velocities are large and short-lived: the error of the terminal estimate counts.
        loss = (error * (1 - tau + 1 / 10)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(flow.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        errors.append(loss.detach())
    return float(torch.stack(errors[-steps // 10 :]).mean().sqrt())
