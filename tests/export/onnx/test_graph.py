"""The exported graph against torch autograd, the numpy runtime and what the file promises."""

import numpy as np
import onnx
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import random_weights
from torch_oracle import velocity

from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.onnx_policy import OnnxPolicy
from export.onnx.graph import velocity_graph
from export.onnx.jacobian import with_jacobian


def onnx_policy(weights, path, batch):
    onnx.save(with_jacobian(velocity_graph(weights)), path)
    return OnnxPolicy(path, weights.action_dim, weights.observation_dim, steps=10, batch=batch)


def inputs(batch, seed=3):
    draw = np.random.default_rng(seed)
    return draw.normal(0, 1.5, (batch, 2)), draw.uniform(size=batch), draw.normal(size=(batch, 7))


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**16),
    hidden=st.sampled_from([(3,), (16, 8), (64, 64, 64)]),
    activation=st.sampled_from(["silu", "tanh"]),
    prior_std=st.sampled_from([None, 0.3, 1.0]),
    features=st.sampled_from([0, 4]),
)
def test_agrees_with_the_numpy_runtime(tmp_path_factory, seed, hidden, activation, prior_std, features):
    weights = random_weights(seed, 2, 7, hidden, activation, prior_std, features)
    policy = onnx_policy(weights, tmp_path_factory.mktemp("graph") / "policy.onnx", batch=50)
    expected = FlowPolicy(weights, 10, 50).evaluate(*inputs(50))
    np.testing.assert_allclose(policy.evaluate(*inputs(50)), expected, rtol=5e-6, atol=5e-6)


@pytest.mark.parametrize("activation", ["silu", "tanh"])
def test_agrees_with_autograd(tmp_path, activation):
    weights = random_weights(0, 2, 7, (24, 16), activation)
    computed = onnx_policy(weights, tmp_path / "policy.onnx", batch=8).evaluate(*inputs(8))
    for row, (action, tau, observation) in enumerate(zip(*inputs(8), strict=True)):
        at = torch.tensor(action.astype(np.float32), dtype=torch.float64)
        jacobian = torch.autograd.functional.jacobian(
            lambda a, t=tau, o=observation: velocity(weights, a, t, o), at
        )
        expected = velocity(weights, at, tau, observation)
        np.testing.assert_allclose(computed[0, row], expected, rtol=5e-6, atol=5e-6)
        np.testing.assert_allclose(computed[1:, row], jacobian.T, rtol=5e-6, atol=5e-6)


def test_inputs_and_outputs_are_as_documented():
    graph = with_jacobian(velocity_graph(random_weights(observation_dim=7))).graph
    shapes = {
        value.name: [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
        for value in (*graph.input, *graph.output)
    }
    assert shapes == {
        "action": ["batch", 2],
        "tau": ["batch", 1],
        "observation": ["batch", 7],
        "velocity": ["batch", 2],
        "jacobian": ["batch", 2, 2],
    }
