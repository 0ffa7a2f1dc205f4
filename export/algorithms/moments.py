"""Running mean and variance, shared by all workers: what observations and rewards are normalised by."""

import torch
from torch import Tensor, nn

from export.common.distributed import Workers

VARIANCE_FLOOR = 1e-4
"""Keeps a component that hardly varies (a range sensor that sees nobody) from being blown up."""


class RunningMoments(nn.Module):
    """Mean and variance of all vectors (.., D) seen so far; zero and one before the first."""

    count: Tensor
    mean: Tensor
    variance: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(size, dtype=torch.float64))

    @property
    def deviation(self) -> Tensor:
        """Standard deviation (D,) in float64, floored."""
        return (self.variance + VARIANCE_FLOOR).sqrt()

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (.., D): an affine map, never clamped, so that it folds into a linear layer."""
        return (x - self.mean.to(x.dtype)) / self.deviation.to(x.dtype)

    def update(self, x: Tensor, workers: Workers) -> None:
        """Merge the samples (.., D) of every worker (parallel variance, Chan et al. 1979)."""
        x = x.reshape(-1, x.shape[-1]).double()
        mean = workers.mean(x.mean(0))
        # The square of each worker's offset belongs to the variance of the union.
        variance = workers.mean(((x - mean) ** 2).mean(0))
        count = float(len(x) * workers.count)
        total = self.count + count
        offset = mean - self.mean
        self.variance.copy_(
            (self.variance * self.count + variance * count) / total
            + offset**2 * self.count * count / total**2
        )
        self.mean.add_(offset * count / total)
        self.count.copy_(total)
