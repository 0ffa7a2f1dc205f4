"""Random flow networks, and the engines of the compiled kernel."""

import itertools

import numpy as np
import pytest

from edge_runtime.policy.compiled_policy import compiled_engines
from edge_runtime.policy.weights import FlowWeights


def random_weights(
    seed=0, action_dim=2, observation_dim=18, hidden=(32, 24), activation="silu", prior_std=0.5, features=4
) -> FlowWeights:
    """A flow network whose layers keep signals of order one."""
    draw = np.random.default_rng(seed)

    def layer(rows, columns, fan_in):
        return (draw.standard_normal((rows, columns)) / np.sqrt(fan_in)).astype(np.float32)

    fan_in = action_dim + observation_dim + 1 + features
    widths = (*hidden, action_dim)
    return FlowWeights(
        activation=activation,
        action=layer(action_dim, hidden[0], fan_in),
        observation=layer(observation_dim, hidden[0], fan_in),
        time=layer(1 + features, hidden[0], fan_in),
        time_frequency=(2 * np.pi * draw.uniform(0.5, 3, features)).astype(np.float32),
        time_phase=draw.uniform(0, np.pi, features).astype(np.float32),
        matrices=tuple(layer(a, b, a) for a, b in itertools.pairwise(widths)),
        biases=tuple((0.1 * draw.standard_normal(width)).astype(np.float32) for width in widths),
        prior_std=prior_std,
    )


ENGINES = compiled_engines()


needs_kernel = pytest.mark.skipif(not ENGINES, reason="the compiled kernel was not built")
