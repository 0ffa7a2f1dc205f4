"""A foreign graph is brought into the bundle's form, or refused by what it has."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from torch import nn
from velocity_nets import OBSERVATION, Mlp, export, graph_of

from edge_runtime.errors import PolicyError
from export.onnx.foreign import read_velocity_graph
from export.onnx.jacobian import with_jacobian

op = helper.make_node


def refusal(model, tmp_path, action_dim=2, observation_dim=2):
    path = tmp_path / "net.onnx"
    if isinstance(model, bytes):
        path.write_bytes(model)
    elif model is not None:
        onnx.save(model, path)
    with pytest.raises(PolicyError) as caught:
        read_velocity_graph(path, action_dim, observation_dim)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def test_sole_output_becomes_velocity_and_the_batch_is_freed(tmp_path):
    model = read_velocity_graph(export(Mlp(), tmp_path / "net.onnx", dynamic=False), 2, OBSERVATION)
    assert [output.name for output in model.graph.output] == ["velocity"]
    for value in (*model.graph.input, *model.graph.output):
        assert value.type.tensor_type.shape.dim[0].dim_param == "batch"


def test_only_what_leads_to_velocity_is_kept(tmp_path):
    model = graph_of(op("Tanh", ["action"], ["velocity"]), op("Sinh", ["action"], ["aside"]))
    model.graph.output.append(helper.make_tensor_value_info("aside", TensorProto.FLOAT, ["batch", 2]))
    onnx.save(model, tmp_path / "net.onnx")
    kept = read_velocity_graph(tmp_path / "net.onnx", 2, 2)
    assert [node.op_type for node in kept.graph.node] == ["Tanh"]
    assert [value.name for value in kept.graph.input] == ["action", "tau", "observation"]


def test_own_bundle_graph_can_be_read_again(tmp_path):
    onnx.save(with_jacobian(graph_of(op("Tanh", ["action"], ["velocity"]))), tmp_path / "net.onnx")
    kept = read_velocity_graph(tmp_path / "net.onnx", 2, 2)
    assert [node.op_type for node in kept.graph.node] == ["Tanh"]


def test_functions_are_inlined(tmp_path):
    opset = [helper.make_opsetid("", 17)]
    squash = helper.make_function("mine", "Squash", ["x"], ["y"], [op("Tanh", ["x"], ["y"])], opset)
    model = graph_of(op("Squash", ["action"], ["velocity"], domain="mine"))
    model.functions.append(squash)
    model.opset_import.append(helper.make_opsetid("mine", 1))
    onnx.save(model, tmp_path / "net.onnx")
    assert [node.op_type for node in read_velocity_graph(tmp_path / "net.onnx", 2, 2).graph.node] == ["Tanh"]


def test_old_opsets_are_converted(tmp_path):
    path = export(Mlp(nn.ELU), tmp_path / "net.onnx", opset_version=11)
    assert read_velocity_graph(path, 2, OBSERVATION).opset_import[0].version == 13


def test_other_input_names(tmp_path):
    path = export(Mlp(), tmp_path / "net.onnx", names=("x", "t", "cond"))
    with pytest.raises(PolicyError) as caught:
        read_velocity_graph(path, 2, OBSERVATION)
    assert "has inputs x, t, cond; needs exactly action, tau, observation: rename them" in str(caught.value)


def test_other_sizes(tmp_path):
    model = graph_of(op("Tanh", ["action"], ["velocity"]))
    assert refusal(model, tmp_path, observation_dim=18) == (
        "input observation is float (batch, 2); the policy's facts need float (batch, 18)"
    )
    assert "input action is float (batch, 2); the policy's facts need float (batch, 3)" in refusal(
        model, tmp_path, action_dim=3
    )


def test_flat_tau(tmp_path):
    model = graph_of(op("Tanh", ["action"], ["velocity"]))
    del model.graph.input[1].type.tensor_type.shape.dim[1]
    assert "input tau is float (batch); the policy's facts need float (batch, 1)" in refusal(model, tmp_path)


def test_other_element_types(tmp_path):
    model = graph_of(op("Cast", ["action"], ["velocity"], to=TensorProto.FLOAT))
    model.graph.input[0].type.tensor_type.elem_type = TensorProto.DOUBLE
    assert "input action is double (batch, 2)" in refusal(model, tmp_path)


def test_several_outputs(tmp_path):
    model = graph_of(op("Tanh", ["action"], ["a"]), op("Neg", ["a"], ["b"]))
    del model.graph.output[:]
    for name in ("a", "b"):
        model.graph.output.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", 2]))
    assert refusal(model, tmp_path) == "has outputs a, b; needs one, or one named velocity"


@pytest.mark.parametrize("content", [b"no graph", b"\x08\x08"])
def test_no_onnx_file(tmp_path, content):
    message = refusal(content, tmp_path)
    assert message.startswith(("not an ONNX file", "has inputs none"))


def test_missing_file(tmp_path):
    assert refusal(None, tmp_path) == "cannot be read (No such file or directory)"


def test_weights_that_are_not_finite(tmp_path):
    constants = {"w": np.array([[1, np.inf], [0, 1]], np.float32)}
    model = graph_of(op("MatMul", ["action", "w"], ["velocity"]), constants=constants)
    assert refusal(model, tmp_path) == "constant w holds values that are not finite"
