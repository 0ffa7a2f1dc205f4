"""Differentiated graphs, run by onnxruntime, against torch autograd."""

import functools

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx import TensorProto, helper
from torch import nn
from velocity_graphs import graph_of
from velocity_nets import OBSERVATION, Attention, Mlp, Normed, Residual, autograd, export

from edge_runtime.errors import PolicyError
from export.bundle.parity import Inputs
from export.onnx.foreign import read_velocity_graph
from export.onnx.jacobian import with_jacobian
from export.onnx.reference import GraphReference


def run(model, **inputs):
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(["velocity", "jacobian"], inputs)


def inputs(batch=20):
    generator = torch.Generator().manual_seed(1)
    return (
        torch.randn(batch, 2, generator=generator),
        torch.rand(batch, 1, generator=generator),
        torch.randn(batch, OBSERVATION, generator=generator),
    )


ACTIVATIONS = [
    nn.SiLU, nn.Tanh, nn.ReLU, nn.ELU, nn.GELU, nn.Softplus, nn.LeakyReLU, nn.SELU, nn.Sigmoid, nn.Mish,
    nn.Hardtanh, functools.partial(nn.GELU, "tanh"), functools.partial(nn.Softmax, -1),
]  # fmt: skip


@pytest.mark.parametrize("net", [
    *(Mlp(activation) for activation in ACTIVATIONS), Residual(), Normed(), Normed(nn.ELU), Attention(),
])  # fmt: skip
def test_torch_networks(tmp_path, net):
    graph = with_jacobian(read_velocity_graph(export(net, tmp_path / "net.onnx"), 2, OBSERVATION))
    action, tau, observation = inputs()
    velocity, jacobian = run(graph, action=action.numpy(), tau=tau.numpy(), observation=observation.numpy())
    expected, derivatives = autograd(net, action, tau, observation)
    np.testing.assert_allclose(velocity, expected, atol=2e-6, rtol=2e-6)
    np.testing.assert_allclose(jacobian, derivatives, atol=3e-6, rtol=3e-6)


def test_layer_normalization_as_one_operator(tmp_path):
    path = export(Normed(), tmp_path / "net.onnx", opset_version=17)
    assert "LayerNormalization" in {node.op_type for node in onnx.load(path).graph.node}
    graph = with_jacobian(read_velocity_graph(path, 2, OBSERVATION))
    action, tau, observation = inputs()
    _, jacobian = run(graph, action=action.numpy(), tau=tau.numpy(), observation=observation.numpy())
    np.testing.assert_allclose(
        jacobian, autograd(Normed(), action, tau, observation)[1], atol=3e-6, rtol=3e-6
    )


op = helper.make_node
F32 = np.float32
MATRIX = np.array([[1.0, -2.0], [0.5, 3.0]], F32)
OPERATORS = {
    "Abs": [op("Abs", ["action"], ["velocity"])],
    "Add broadcasts": [
        op("ReduceSum", ["action", "axis"], ["s"], keepdims=1), op("Add", ["s", "observation"], ["velocity"]),
    ],
    "Cos": [op("Cos", ["action"], ["velocity"])],
    "Div": [op("Exp", ["action"], ["e"]), op("Div", ["observation", "e"], ["velocity"])],
    "Div by itself": [op("Exp", ["action"], ["e"]), op("Div", ["action", "e"], ["velocity"])],
    "Erf": [op("Erf", ["action"], ["velocity"])],
    "Gather": [op("Gather", ["action", "swap"], ["velocity"], axis=1)],
    "Gemm": [op("Gemm", ["action", "m", "action"], ["velocity"], alpha=2.0, beta=0.5, transB=1)],
    "Gemm without C": [op("Gemm", ["action", "m", ""], ["velocity"], alpha=2.0, transB=1)],
    "Log": [op("Exp", ["action"], ["e"]), op("Add", ["e", "one"], ["f"]), op("Log", ["f"], ["velocity"])],
    "Max": [op("Max", ["action", "observation"], ["velocity"])],
    "Min": [op("Min", ["observation", "action"], ["velocity"])],
    "Neg": [op("Neg", ["action"], ["velocity"])],
    "Pow": [op("Pow", ["action", "three"], ["velocity"])],
    "Reciprocal": [op("Exp", ["action"], ["e"]), op("Reciprocal", ["e"], ["velocity"])],
    "ReduceMean": [
        op("ReduceMean", ["action"], ["s"], axes=[1]), op("Mul", ["s", "action"], ["velocity"]),
    ],
    "Sign and Floor": [
        op("Sign", ["action"], ["s"]), op("Floor", ["action"], ["f"]), op("Add", ["s", "f"], ["g"]),
        op("Mul", ["g", "action"], ["velocity"]),
    ],
    "Sin": [op("Sin", ["action"], ["velocity"])],
    "Slice": [
        op("Slice", ["action", "zero", "unit", "axis"], ["x"]),
        op("Concat", ["x", "tau"], ["velocity"], axis=-1),
    ],
    "Sub": [
        op("ReduceSum", ["action", "axis"], ["s"], keepdims=1), op("Sub", ["observation", "s"], ["velocity"]),
    ],
    "Sum": [op("Sum", ["action", "tau", "action"], ["velocity"])],
    "Tile": [
        op("Slice", ["action", "zero", "unit", "axis"], ["x"]), op("Tile", ["x", "twice"], ["velocity"]),
    ],
    "Where": [
        op("Greater", ["action", "observation"], ["c"]), op("Where", ["c", "action", "tau"], ["velocity"]),
    ],
    "double": [
        op("Cast", ["action"], ["a"], to=TensorProto.DOUBLE), op("Sigmoid", ["a"], ["s"]),
        op("Cast", ["s"], ["velocity"], to=TensorProto.FLOAT),
    ],
}  # fmt: skip
CONSTANTS = {
    "axis": [1], "zero": [0], "unit": [1], "twice": [1, 2], "swap": [1, 0], "m": MATRIX,
    "three": F32(3), "one": F32(1),
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_single_operators(name):
    """Against differences in double precision, at actions away from every kink."""
    model = graph_of(*OPERATORS[name], constants=CONSTANTS)
    draw = np.random.default_rng(2)
    at = Inputs(draw.normal(size=(12, 2)), draw.uniform(size=12), draw.normal(size=(12, 2)))
    at = Inputs(*(array.astype(np.float32).astype(float) for array in at.arrays()))
    expected = GraphReference(model).evaluate(at)
    velocity, jacobian = run(
        with_jacobian(model),
        action=at.action.astype(np.float32),
        tau=at.tau[:, None].astype(np.float32),
        observation=at.observation.astype(np.float32),
    )
    np.testing.assert_allclose(velocity, expected[0], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(np.moveaxis(jacobian, 2, 0), expected[1:], rtol=1e-5, atol=1e-6)


def test_swish_of_the_newest_opset():
    model = graph_of(op("Swish", ["action"], ["velocity"], alpha=0.5), opset=24)
    at = Inputs(np.array([[0.3, -1.2]]), np.zeros(1), np.zeros((1, 2)))
    feed = {
        "action": at.action.astype(F32),
        "tau": np.zeros((1, 1), F32),
        "observation": np.zeros((1, 2), F32),
    }
    computed = onnx.reference.ReferenceEvaluator(with_jacobian(model)).run(["jacobian"], feed)[0]
    np.testing.assert_allclose(np.moveaxis(computed, 2, 0), GraphReference(model).evaluate(at)[1:], atol=1e-6)


def test_unsupported_operator_is_named():
    with pytest.raises(PolicyError) as caught:
        with_jacobian(graph_of(op("Sinh", ["action"], ["velocity"])))
    assert str(caught.value).startswith("operator Sinh cannot be differentiated; supported are Abs, Add, ")


def test_unsupported_operator_beside_the_action_is_fine():
    model = graph_of(op("Sinh", ["observation"], ["s"]), op("Mul", ["s", "action"], ["velocity"]))
    assert [output.name for output in with_jacobian(model).graph.output] == ["velocity", "jacobian"]


def test_exponent_that_varies_is_refused():
    with pytest.raises(PolicyError, match="Pow cannot be differentiated by an exponent that depends"):
        with_jacobian(graph_of(op("Pow", ["observation", "action"], ["velocity"])))


@pytest.mark.parametrize("node", [
    op("Clip", ["observation", "s"], ["velocity"]),
    op("LayerNormalization", ["observation", "action"], ["velocity"]),
])  # fmt: skip
def test_inputs_whose_derivative_no_rule_knows_are_refused(node):
    with pytest.raises(
        PolicyError, match=f"operator {node.op_type} can be differentiated by its first input alone"
    ):
        with_jacobian(graph_of(op("ReduceSum", ["action"], ["s"], keepdims=0), node))


def test_an_output_that_is_not_wanted():
    """Its empty name is not one that depends on the action."""
    nodes = [
        op("Split", ["action", "halves"], ["", "half"], axis=1), op("Clip", ["half", "", "three"], ["x"]),
        op("Concat", ["x", "x"], ["velocity"], axis=1),
    ]  # fmt: skip
    with_jacobian(graph_of(*nodes, constants={**CONSTANTS, "halves": [1, 1]}))


def test_velocity_without_action_is_refused():
    with pytest.raises(PolicyError, match="velocity does not depend on action"):
        with_jacobian(graph_of(op("Identity", ["observation"], ["velocity"])))
