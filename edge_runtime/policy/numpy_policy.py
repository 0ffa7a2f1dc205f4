"""The velocity field of a flow policy and its Jacobian, computed together in numpy.

Forward mode: every layer multiplies one matrix whose rows are the values of all B inputs followed by
their d tangents, so a layer costs one product. What depends on the observation is computed once a tick,
what depends on flow time once at load.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy import add, multiply, subtract, tanh

from edge_runtime.common.arrays import Array
from edge_runtime.policy.flow_steps import SamplerName, flow_steps
from edge_runtime.policy.velocity_field import check_counts, check_observation
from edge_runtime.policy.weights import FlowWeights


class _Layer:
    """Buffers of one hidden layer: rows are B values, then d times B tangents, padded."""

    def __init__(self, rows: int, batch: int, action_dim: int, width: int, extra: int) -> None:
        tangents = slice(batch, batch * (1 + action_dim))
        self.before = np.zeros((rows, width), np.float32)
        self.before_value = self.before[:batch]
        # The extra columns multiply the next layer's bias (and the prior field): no separate addition.
        self.after = np.zeros((rows, width + extra), np.float32)
        self.after[:batch, width] = 1.0
        self.after_value = self.after[:batch, :width]
        self.gate = np.empty((batch, width), np.float32)
        self.slope = np.empty((batch, width), np.float32)
        # One product per tangent: numpy takes longer to broadcast a slope over all of them.
        self.tangents = list(
            zip(
                self.before[tangents].reshape(action_dim, batch, width),
                self.after[tangents].reshape(action_dim, batch, width + extra)[..., :width],
                strict=True,
            )
        )


class _Rows(NamedTuple):
    """What one pass computes: the values alone, or their tangents with them."""

    products: list[tuple[Array, Array, Array, _Layer]]
    """What each layer's product reads and writes; the layer."""
    final: Array
    """What the last one reads."""
    product: Array
    """What it writes."""
    result: Array
    """Of that, what is wanted: (1 or 1 + d, B, d)."""
    tangents: bool


class FlowPolicy:
    """v_theta(a, tau | o) and dv/da for B inputs at once (paper, section II; DESIGN: forward mode).

    Args:
        weights: the network.
        steps: T, the number of flow steps that ``step`` is prepared for.
        batch: B, fixed because every buffer is allocated here.
        sampler: how the flow is integrated in them.

    Raises:
        PolicyError: if ``steps`` or ``batch`` is below one.
    """

    backend = "numpy"
    sampler = None

    def __init__(
        self, weights: FlowWeights, steps: int, batch: int = 1, sampler: SamplerName = "euler"
    ) -> None:
        check_counts(steps, batch)
        self.batch, self.schedule = batch, flow_steps(sampler, steps, weights.prior_std)
        self.action_dim, self.observation_dim = weights.action_dim, weights.observation_dim
        self._weights = weights
        self._silu = weights.activation == "silu"
        # SiLU(x) = u (1 + tanh u) with u = x / 2: the half is folded into every layer that feeds one.
        half = np.float32(0.5 if self._silu else 1.0)
        self._half = half
        tau = np.array([step.tau for step in self.schedule])
        self._action_rows = np.ascontiguousarray(weights.action * half)
        self._observation_rows = np.ascontiguousarray(weights.observation * half)
        self._time_parts = (weights.time_part(tau) * half).astype(np.float32)[:, None, :]
        self._offsets = np.empty((steps, batch, weights.hidden[0]), np.float32)
        self._observed = np.empty((batch, weights.hidden[0]), np.float32)
        self._stacked = [
            np.vstack([matrix, bias]).astype(np.float32) * half
            for matrix, bias in zip(weights.matrices[:-1], weights.biases[1:-1], strict=True)
        ]
        self._output = [self._output_matrix(float(gain)) for gain in weights.prior_gain(tau)]
        self._allocate(weights)

    def _output_matrix(self, prior_gain: float) -> Array:
        """The last layer with its bias and the prior field k(tau) a as further rows."""
        prior = prior_gain * np.eye(self.action_dim)
        stacked = np.vstack([self._weights.matrices[-1], self._weights.biases[-1], prior])
        return np.asfortranarray(stacked, np.float32)  # few columns multiply faster one after the other

    def _allocate(self, weights: FlowWeights) -> None:
        batch, d = self.batch, self.action_dim
        rows = batch * (1 + d)
        rows += -rows % 4 if rows < 8 else 0  # few-row products run faster on whole vector registers
        last = len(weights.hidden) - 1
        self._layers = [
            _Layer(rows, batch, d, width, extra=1 + d if index == last else 1)
            for index, width in enumerate(weights.hidden)
        ]
        # The first layer's tangents before its activation are the action's weight rows themselves.
        first = self._layers[0]
        first.tangents = [
            (row, after) for row, (_, after) in zip(self._action_rows, first.tangents, strict=True)
        ]
        final = self._layers[-1].after
        self._action = final[:batch, -d:]
        final[batch : batch * (1 + d)].reshape(d, batch, -1)[..., -d:] = np.eye(d)[:, None, :]
        result = np.empty((rows, d), np.float32)
        self._all, self._values = self._rows(result), self._rows(result[:batch])
        # Arrays of no dimension: numpy is slower with its own scalars.
        self._one, self._two = np.array(1.0, np.float32), np.array(2.0, np.float32)

    def _rows(self, product: Array) -> _Rows:
        """As many of the layers' rows as ``product`` has, which the last layer writes."""
        count, batch, d = len(product), self.batch, self.action_dim
        kinds = 1 if count == batch else 1 + d
        products = [
            (above.after[:count], matrix, layer.before[:count], layer)
            for above, matrix, layer in zip(self._layers, self._stacked, self._layers[1:], strict=False)
        ]
        result = product[: batch * kinds].reshape(kinds, batch, d)
        return _Rows(products, self._layers[-1].after[:count], product, result, kinds > 1)

    def observe(self, observation: npt.ArrayLike) -> None:
        """Set the observations (B, O) for the coming steps.

        Raises:
            PolicyError: if the shape is not (B, O).
        """
        observation = np.asarray(observation, np.float32)
        check_observation(observation, self.batch, self.observation_dim)
        observation.dot(self._observation_rows, self._observed)
        add(self._time_parts, self._observed, self._offsets)

    def step(self, k: int, action: npt.ArrayLike) -> Array:
        """Velocity and Jacobian at the beginning of a step; see `VelocityField.step`."""
        self._action[:] = action
        return self._forward(self._offsets[k], self._output[k], self._all)

    def velocity(self, k: int, action: npt.ArrayLike) -> Array:
        """The velocity alone; see `VelocityField.velocity`."""
        self._action[:] = action
        return self._forward(self._offsets[k], self._output[k], self._values)[0]

    def evaluate(self, action: npt.ArrayLike, tau: npt.ArrayLike, observation: npt.ArrayLike) -> Array:
        """Evaluate at any flow time: action (B, d), tau (B,), observation (B, O) -> (1 + d, B, d).

        Slower than ``step`` and independent of ``observe``; for parity checks and analysis.
        """
        tau = np.asarray(tau, np.float64)
        self._action[:] = action
        observed = np.asarray(observation, np.float32) @ self._observation_rows
        offset = (observed + self._weights.time_part(tau) * self._half).astype(np.float32)
        result = self._forward(offset, self._output_matrix(0.0), self._all).copy()
        gain = self._weights.prior_gain(tau).astype(np.float32)[:, None]
        result[0] += gain * self._action
        for j in range(self.action_dim):
            result[1 + j, :, j] += gain[:, 0]
        return result

    def _forward(self, offset: Array, output: Array, rows: _Rows) -> Array:
        first = self._layers[0]
        self._action.dot(self._action_rows, first.before_value)
        add(first.before_value, offset, first.before_value)
        self._activate(first, tangents=rows.tangents)
        for above, matrix, below, layer in rows.products:
            above.dot(matrix, below)
            self._activate(layer, tangents=rows.tangents)
        rows.final.dot(output, rows.product)
        return rows.result

    def _activate(self, layer: _Layer, *, tangents: bool) -> None:
        """The activation's value, and its slope times the tangents, in place."""
        u, gate, slope = layer.before_value, layer.gate, layer.slope
        if self._silu:
            tanh(u, gate)
            add(gate, self._one, gate)  # g = 1 + tanh u = 2 sigmoid(x)
            multiply(u, gate, layer.after_value)  # SiLU(x) = u g
            if not tangents:
                return
            subtract(self._two, gate, slope)
            multiply(slope, layer.after_value, slope)
            add(slope, gate, slope)  # d SiLU / du = g + u g (2 - g)
        else:
            tanh(u, layer.after_value)
            if not tangents:
                return
            multiply(layer.after_value, layer.after_value, slope)
            subtract(self._one, slope, slope)
        for before, after in layer.tangents:
            multiply(before, slope, after)
