"""Generalised advantage estimation."""

import torch
from torch import Tensor


def advantages(
    reward: Tensor, value: Tensor, last_value: Tensor, done: Tensor, *, discount: float, gae_lambda: float
) -> Tensor:
    """Exponentially weighted sums of temporal differences (Schulman et al. 2016, eq. 16).

    Args:
        reward: (K, B, N); a step cut by a time limit already holds the discounted value beyond it.
        value: (K, B, N) of the states that the actions were taken in.
        last_value: (B, N) of the state after the last step.
        done: (K, B) bool: the episode ended with this step.
        discount: gamma.
        gae_lambda: lambda.

    Returns:
        (K, B, N)
    """
    following = torch.cat([value[1:], last_value[None]])
    goes_on = (~done)[..., None].to(reward.dtype)
    difference = reward + discount * goes_on * following - value
    result = torch.empty_like(reward)
    carried = torch.zeros_like(last_value)
    for k in reversed(range(len(reward))):
        carried = difference[k] + discount * gae_lambda * goes_on[k] * carried
        result[k] = carried
    return result
