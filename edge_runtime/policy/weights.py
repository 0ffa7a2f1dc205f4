"""The weights of a flow network, in the one layout that training, export and every backend share.

The velocity field of action a at flow time tau, given observation o, is a multi-layer perceptron plus a
linear prior field,

    v(a, tau | o) = MLP([a, o, phi(tau)]) + k(tau) a,
    phi(tau) = [tau, sin(frequency tau + phase)],
    k(tau) = (tau s^2 - (1 - tau)) / ((1 - tau)^2 + tau^2 s^2).

With s = ``prior_std`` and a zero MLP the flow transports N(0, I) to N(0, s^2 I) along the optimal
transport path of eq. 3; without a prior, k is zero. Layers multiply from the right, x W + b, and
normalisation of the observation is already folded into the first layer.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Array, Floats
from edge_runtime.policy.flow_steps import prior_gain

Activation = Literal["silu", "tanh"]


@dataclass(frozen=True)
class FlowWeights:
    """Float32 arrays of one flow network with L hidden layers of widths H1..HL."""

    activation: Activation
    action: Array
    """(d, H1): the action's rows of the first layer."""
    observation: Array
    """(O, H1): the observation's rows of the first layer."""
    time: Array
    """(1 + F, H1): the time features' rows of the first layer, tau itself first."""
    time_frequency: Array
    """(F,) in radians per unit of flow time."""
    time_phase: Array
    """(F,) in radians."""
    matrices: tuple[Array, ...]
    """L matrices (H1, H2), ..., (HL, d): the layers after the first."""
    biases: tuple[Array, ...]
    """L + 1 vectors (H1,), ..., (HL,), (d,)."""
    prior_std: float | None = None
    """s of the prior field; None for none."""

    @property
    def action_dim(self) -> int:
        """Size d of the action."""
        return int(self.action.shape[0])

    @property
    def observation_dim(self) -> int:
        """Size O of the observation."""
        return int(self.observation.shape[0])

    @property
    def hidden(self) -> tuple[int, ...]:
        """Widths of the hidden layers."""
        return tuple(int(b.shape[0]) for b in self.biases[:-1])

    def time_part(self, tau: npt.ArrayLike) -> Floats:
        """What flow time adds to the first layer: tau (...,) in [0, 1] -> (..., H1), bias included."""
        tau = np.asarray(tau, np.float64)[..., None]
        features = np.concatenate([tau, np.sin(tau * self.time_frequency + self.time_phase)], -1)
        return np.asarray(features @ self.time + self.biases[0])

    def prior_gain(self, tau: npt.ArrayLike) -> Floats:
        """k(tau) of the prior field: (...,) -> (...,)."""
        tau = np.asarray(tau, np.float64)
        if self.prior_std is None:
            return np.zeros_like(tau)
        return np.asarray(prior_gain(tau, self.prior_std))
