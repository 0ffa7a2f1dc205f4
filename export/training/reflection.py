"""Learning from reflected experience: what a mirrored team would have seen, done and earned."""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from export.scenarios.scenario import Mirror


class Experience(NamedTuple):
    """What is learned from, of K control steps of B teams of N robots."""

    observation: Tensor
    """(K, B, N, O)"""
    action: Tensor
    """(K, B, N, d)"""
    trace: Tensor
    """(K, B, N, X), see ``export.algorithms.base.Algorithm``."""
    log_likelihood: Tensor
    """(K, B, N), of the actions under the policy that took them."""
    advantage: Tensor
    """(K, B, N)"""
    value_target: Tensor
    """(K, B, N)"""


def with_reflection(
    seen: Experience, mirror: Mirror, reflect_trace: Callable[[Tensor, Tensor], Tensor]
) -> Experience:
    """Put the mirrored teams' experience beside the teams' own: K becomes 2 K.

    A policy that learns from its own alone gets good at one side first, and may stay poor at the other. The
    mirrored policy took the mirrored actions: its likelihoods are the policy's own.

    Args:
        seen: the teams' own.
        mirror: the task's symmetry.
        reflect_trace: traces (.., X) and the action's signs (d,) -> what the mirrored actions leave.
    """
    signs = (torch.tensor(each, device=seen.action.device) for each in (mirror.observation, mirror.action))
    observation, action = signs
    backwards = Experience(*(values.flip(2) for values in seen))
    reflected = backwards._replace(
        observation=backwards.observation * observation,
        action=backwards.action * action,
        trace=reflect_trace(backwards.trace, action),
    )
    return Experience(*(torch.cat(pair) for pair in zip(seen, reflected, strict=True)))
