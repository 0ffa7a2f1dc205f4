"""Third-party MLPs become weights of the numpy runtime, whatever their nodes look like."""

import numpy as np
import onnx
import pytest
import torch
from networks import random_weights
from torch import nn
from velocity_graphs import graph_of
from velocity_nets import OBSERVATION, Attention, Mlp, Normed, Residual, autograd, export

from edge_runtime.policy.numpy_policy import FlowPolicy
from export.onnx.affine import NotAnMlpError
from export.onnx.foreign import read_velocity_graph
from export.onnx.graph import velocity_graph
from export.onnx.mlp import read_flow_weights

op = onnx.helper.make_node


class SplitFirstLayer(Mlp):
    """A sum of separate products instead of a concatenation, scaled in and out, without biases or sines."""

    def __init__(self):
        super().__init__()
        self.of_action, self.of_observation, self.of_tau = (
            nn.Linear(size, 16, bias=False) for size in (2, OBSERVATION, 1)
        )

    def forward(self, action, tau, observation):
        x = self.of_observation(-observation * 2) + self.of_tau(1 - tau) - self.of_action(action / 3)
        x = x + self.of_action(action)
        return 0.5 * self.last(self.activation(self.second(self.activation(x))))


class OneLayer(Mlp):
    def forward(self, action, tau, observation):
        return self.last(self.activation(self.first(self.features(action, tau, observation))))


@pytest.mark.parametrize("net", [Mlp(), Mlp(nn.Tanh), SplitFirstLayer(), OneLayer()])
def test_torch_mlp_is_converted(tmp_path, net):
    weights = read_flow_weights(read_velocity_graph(export(net, tmp_path / "n.onnx"), 2, OBSERVATION))
    action, tau, observation = torch.randn(30, 2), torch.rand(30, 1), torch.randn(30, OBSERVATION)
    velocity, jacobian = autograd(net, action, tau, observation)
    computed = FlowPolicy(weights, 10, 30).evaluate(action, tau[:, 0], observation)
    np.testing.assert_allclose(computed[0], velocity, rtol=3e-6, atol=3e-6)
    np.testing.assert_allclose(np.moveaxis(computed[1:], 0, 2), jacobian, rtol=3e-6, atol=3e-6)


@pytest.mark.parametrize("activation", ["silu", "tanh"])
@pytest.mark.parametrize("features", [0, 3])
def test_own_graph_gives_back_the_same_weights(activation, features):
    weights = random_weights(activation=activation, prior_std=None, features=features)
    read = read_flow_weights(velocity_graph(weights))
    assert (read.activation, read.prior_std) == (activation, None)
    for name in ("action", "observation", "time", "time_frequency", "time_phase", "matrices", "biases"):
        for ours, theirs in zip(getattr(read, name), getattr(weights, name), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_swish_operator():
    constants = {"w": np.ones((5, 3), np.float32), "u": np.ones((3, 2), np.float32)}
    x = [op("Concat", ["tau", "action", "observation"], ["x"], axis=1), op("MatMul", ["x", "w"], ["y"])]
    plain = graph_of(
        *x, op("Swish", ["y"], ["z"]), op("MatMul", ["z", "u"], ["velocity"]), constants=constants, opset=24
    )
    assert read_flow_weights(plain).activation == "silu"
    steep = op("Swish", ["y"], ["z"], alpha=2.0)
    with pytest.raises(NotAnMlpError, match="Swish has an alpha other than 1"):
        read_flow_weights(
            graph_of(*x, steep, op("MatMul", ["z", "u"], ["velocity"]), constants=constants, opset=24)
        )


def test_a_product_whose_bias_is_left_out_by_an_empty_name():
    constants = {"w": np.ones((5, 3), np.float32), "u": np.ones((3, 2), np.float32)}
    x = op("Concat", ["tau", "action", "observation"], ["x"], axis=1)
    layers = [
        op("Gemm", ["x", "w", ""], ["y"]),
        op("Tanh", ["y"], ["z"]),
        op("Gemm", ["z", "u", ""], ["velocity"]),
    ]
    weights = read_flow_weights(graph_of(x, *layers, constants=constants))
    np.testing.assert_array_equal(weights.matrices[0], constants["u"])
    assert not any(bias.any() for bias in weights.biases)


@pytest.mark.parametrize(
    ("net", "reason"),
    [
        (Residual(), "a skip connection"),
        (Normed(), "LayerNormalization"),
        (Attention(), "is no part of a plain MLP"),
        (Mlp(nn.ReLU), "Relu is no part of a plain MLP"),
        (Mlp(nn.Sigmoid), "is not affine in the inputs or in one layer"),
    ],
)
def test_other_networks_are_not(tmp_path, net, reason):
    path = export(net, tmp_path / "n.onnx", opset_version=17)
    with pytest.raises(NotAnMlpError, match=reason):
        read_flow_weights(read_velocity_graph(path, 2, OBSERVATION))


@pytest.mark.parametrize(
    ("nodes", "reason"),
    [
        ([op("Add", ["action", "observation"], ["velocity"])], "no activation, not one activation"),
        ([op("Mul", ["action", "tau"], ["velocity"])], "action and tau are multiplied"),
        ([op("Cast", ["action"], ["i"], to=7), op("Cast", ["i"], ["velocity"], to=1)], "Cast rounds"),
        ([op("Sin", ["action"], ["velocity"])], "a sine of more than flow time"),
        ([op("Div", ["action", "observation"], ["velocity"])], "observation is a factor or divisor"),
        ([op("Tanh", ["action"], ["velocity"])], "its first layer takes only action"),
        (
            [op("Add", ["action", "observation"], ["x"]), op("Tanh", ["x"], ["y"]),
             op("Sigmoid", ["y"], ["g"]), op("Mul", ["y", "g"], ["velocity"])],
            "its layers use silu, tanh, not one activation",
        ),
    ],
)  # fmt: skip
def test_reasons_of_small_graphs(nodes, reason):
    with pytest.raises(NotAnMlpError, match=reason):
        read_flow_weights(graph_of(*nodes))
