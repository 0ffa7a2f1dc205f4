"""Tensors as affine functions of a network's inputs, time features and hidden layers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from edge_runtime.common.arrays import Array, Floats
from edge_runtime.policy.weights import Activation, FlowWeights


class NotAnMlpError(Exception):
    """The graph is more than `FlowWeights` can express; the message says what."""


@dataclass(frozen=True, eq=False)
class Input:
    """A graph input of the given size."""

    name: str
    size: int


@dataclass(frozen=True, eq=False)
class Sines:
    """sin(frequency tau + phase), F of them."""

    frequency: Floats
    phase: Floats

    @property
    def size(self) -> int:
        """F."""
        return len(self.frequency)


@dataclass(frozen=True, eq=False)
class Hidden:
    """A hidden layer of H units: the activation of what it is fed."""

    fed: "Affine"
    activation: Activation

    @property
    def size(self) -> int:
        """H."""
        return len(self.fed.bias)


Source = Input | Sines | Hidden


@dataclass(frozen=True, eq=False)
class Affine:
    """A tensor (B, n): the sum over sources of source (B, m) @ matrix (m, n), plus a bias (n,)."""

    terms: Mapping[Source, Floats]
    bias: Floats

    def scaled(self, row: Floats) -> "Affine":
        """Multiply column by column with row (n,) or (1,)."""
        return Affine({source: matrix * row for source, matrix in self.terms.items()}, self.bias * row)

    def product(self, matrix: Floats) -> "Affine":
        """Multiply with matrix (n, k) from the right."""
        return Affine({source: term @ matrix for source, term in self.terms.items()}, self.bias @ matrix)


def constant(row: Floats) -> Affine:
    """A row (n,) that is the same for every input."""
    return Affine({}, row)


def total(parts: Sequence[Affine]) -> Affine:
    """Sum tensors of n columns; a single column is repeated."""
    columns = max(len(part.bias) for part in parts)
    terms: dict[Source, Floats] = {}
    for part in parts:
        for source, matrix in part.terms.items():
            terms[source] = terms.get(source, 0.0) + np.broadcast_to(matrix, (source.size, columns))
    return Affine(terms, sum((part.bias for part in parts), np.zeros(columns)))


def concatenated(parts: Sequence[Affine]) -> Affine:
    """Put tensors side by side."""
    placed, start, columns = [], 0, sum(len(part.bias) for part in parts)
    for part in parts:
        placement = np.eye(len(part.bias), columns, start)
        placed.append(part.product(placement))
        start += len(part.bias)
    return total(placed)


def to_flow_weights(velocity: Affine) -> FlowWeights:
    """Write an MLP in the runtime's layout.

    Raises:
        NotAnMlpError: if layers are skipped, missing or of different activations.
    """
    layers = [velocity]
    hidden = _hidden_source(velocity)
    activations = set()
    while hidden is not None:
        activations.add(hidden.activation)
        layers.insert(0, hidden.fed)
        hidden = _hidden_source(hidden.fed)
    if len(activations) != 1:
        raise NotAnMlpError(
            f"its layers use {', '.join(sorted(activations)) or 'no activation'}, not one activation"
        )
    first, *later = layers
    inputs = {source.name: matrix for source, matrix in first.terms.items() if isinstance(source, Input)}
    if inputs.keys() != {"action", "tau", "observation"}:
        raise NotAnMlpError(f"its first layer takes only {', '.join(sorted(inputs))}")
    sines = [source for source in first.terms if isinstance(source, Sines)]
    return FlowWeights(
        activation=activations.pop(),
        action=_float32(inputs["action"]),
        observation=_float32(inputs["observation"]),
        time=_float32(np.vstack([inputs["tau"], *(first.terms[source] for source in sines)])),
        time_frequency=_float32(np.concatenate([np.zeros(0), *(source.frequency for source in sines)])),
        time_phase=_float32(np.concatenate([np.zeros(0), *(source.phase for source in sines)])),
        matrices=tuple(_float32(next(iter(layer.terms.values()))) for layer in later),
        biases=tuple(_float32(layer.bias) for layer in layers),
    )


def _hidden_source(layer: Affine) -> Hidden | None:
    """The one hidden layer that feeds ``layer``; None for the first layer."""
    hidden = [source for source in layer.terms if isinstance(source, Hidden)]
    if hidden and len(layer.terms) > 1:
        raise NotAnMlpError("a layer is fed by more than the layer before it (a skip connection)")
    return hidden[0] if hidden else None


def _float32(array: Floats) -> Array:
    return np.ascontiguousarray(array, np.float32)
