"""What algorithms of exact densities share: PPO's clipped surrogate (Schulman et al. 2017)."""

import torch
from torch import Tensor


class ClippedSurrogate:
    """Ratio and objective; a subclass says how wide the trust region is."""

    clip: float
    """Half-width of the trust region."""

    def ratio(self, new: Tensor, old: Tensor) -> Tensor:
        """Ratio of the densities."""
        return (new - old).exp()

    def objective(self, ratio: Tensor, advantage: Tensor) -> Tensor:
        """The clipped surrogate."""
        clipped = ratio.clamp(1 - self.clip, 1 + self.clip)
        return torch.minimum(ratio * advantage, clipped * advantage)
