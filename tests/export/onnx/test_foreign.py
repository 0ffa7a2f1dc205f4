"""A foreign graph is brought into the bundle's form, or refused by what it has."""

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx import TensorProto, helper
from torch import nn
from velocity_graphs import graph_of
from velocity_nets import OBSERVATION, Mlp, autograd, export

from edge_runtime.errors import PolicyError
from export.bundle.parity import Inputs
from export.onnx.foreign import read_velocity_graph
from export.onnx.graph import lowered
from export.onnx.jacobian import with_jacobian
from export.onnx.mlp import read_flow_weights
from export.onnx.reference import GraphReference

op = helper.make_node


def refusal(model, tmp_path, action_dim=2, observation_dim=2):
    path = tmp_path / "net.onnx"
    if isinstance(model, bytes):
        path.write_bytes(model)
    elif model is not None:
        path.write_bytes(model.SerializeToString())
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


CAT = op("Concat", ["action", "tau", "observation"], ["x"], axis=1)
W = np.random.default_rng(0).normal(size=(5, 8)).astype(np.float32)
V = np.random.default_rng(1).normal(size=(8, 2)).astype(np.float32)


def mlp(activation="Tanh", opset=17):
    layers = [
        op("MatMul", ["x", "w"], ["y"]),
        op(activation, ["y"], ["z"]),
        op("MatMul", ["z", "v"], ["velocity"]),
    ]
    return graph_of(CAT, *layers, constants={"w": W, "v": V}, opset=opset)


def read(model, tmp_path, observation_dim=2):
    (tmp_path / "net.onnx").write_bytes(model.SerializeToString())
    return read_velocity_graph(tmp_path / "net.onnx", 2, observation_dim)


def test_weights_of_the_oldest_form_are_inputs_too(tmp_path):
    model = mlp()
    model.ir_version = 3
    for tensor in model.graph.initializer:
        model.graph.input.append(helper.make_tensor_value_info(tensor.name, tensor.data_type, tensor.dims))
    kept = read(model, tmp_path)
    assert [value.name for value in kept.graph.input] == ["action", "tau", "observation"]
    np.testing.assert_array_equal(read_flow_weights(kept).matrices[0], V)


@pytest.mark.parametrize("ir_version", [0, 3, 8, 13, 10**9])
@pytest.mark.parametrize("opset", [13, 20, 21, 24])
def test_every_onnxruntime_of_a_robot_reads_what_is_written(tmp_path, ir_version, opset):
    model = mlp("Sigmoid", opset)
    model.ir_version = ir_version
    graph = lowered(read(model, tmp_path))
    assert graph.ir_version <= 9
    assert graph.opset_import[0].version <= 20


def test_an_operator_that_only_newer_ones_know(tmp_path):
    model = read(graph_of(op("Swish", ["action"], ["velocity"]), opset=24), tmp_path)
    with pytest.raises(
        PolicyError, match=r"^opset 24 cannot be written as 20.*: export it with opset_version=20$"
    ):
        lowered(model)


@pytest.mark.parametrize("kind", [TensorProto.FLOAT16, TensorProto.BFLOAT16])
def test_half_precision_becomes_single(tmp_path, kind):
    nodes = [
        op("Cast", ["x"], ["h"], to=kind), op("MatMul", ["h", "w"], ["y"]), op("Tanh", ["y"], ["z"]),
        op("MatMul", ["z", "v"], ["u"]), op("Cast", ["u"], ["velocity"], to=TensorProto.FLOAT),
    ]  # fmt: skip
    model = graph_of(CAT, *nodes)
    for name, array in (("w", W), ("v", V)):
        model.graph.initializer.append(helper.make_tensor(name, kind, array.shape, array.flatten()))
    weights = read_flow_weights(read(model, tmp_path))
    assert weights.matrices[0].dtype == np.float32
    np.testing.assert_allclose(weights.matrices[0], V, rtol=2**-8)


def test_values_whose_type_is_the_operators_own(tmp_path):
    nodes = [
        op("Constant", [], ["k"], value_float=2.5), op("Constant", [], ["l"], value_floats=[2.5, 3.5]),
        op("Shape", ["action"], ["s"]), op("ConstantOfShape", ["s"], ["zero"]), op("Tanh", ["action"], ["q"]),
        op("Mul", ["q", "k"], ["r"]), op("Mul", ["r", "l"], ["t"]), op("Add", ["t", "zero"], ["velocity"]),
    ]  # fmt: skip
    at = Inputs(np.array([[0.5, -1.0]]), np.zeros(1), np.zeros((1, 2)))
    expected = np.tanh(at.action) * 2.5 * [2.5, 3.5]
    np.testing.assert_allclose(GraphReference(read(graph_of(*nodes), tmp_path)).evaluate(at)[0], expected)


class Squeezed(Mlp):
    """Squeezes a dimension whose size the exporter does not know: it writes an If."""

    def forward(self, action, tau, observation):
        x = self.activation(self.first(self.features(action, tau, observation)))
        shape = torch.cat([torch.tensor([-1]), torch.tensor([1]), torch.tensor([16])])
        x = x.reshape([size for size in shape]).squeeze(1)  # noqa: C416  # tensors, not numbers
        return self.last(self.activation(self.second(x)))


@pytest.mark.parametrize("opset", [11, 13, 17])
def test_a_branch_that_shapes_decide_takes_its_place(tmp_path, opset):
    net, path = Squeezed(), tmp_path / "net.onnx"
    assert "If" in {node.op_type for node in onnx.load(export(net, path, opset_version=opset)).graph.node}
    model = with_jacobian(read_velocity_graph(path, 2, OBSERVATION))
    assert "If" not in {node.op_type for node in model.graph.node}
    action, tau, observation = torch.randn(6, 2), torch.rand(6, 1), torch.randn(6, OBSERVATION)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    feed = {"action": action.numpy(), "tau": tau.numpy(), "observation": observation.numpy()}
    for found, expected in zip(
        session.run(["velocity", "jacobian"], feed), autograd(net, action, tau, observation), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=3e-6, rtol=3e-6)


def branch(*nodes):
    return helper.make_graph(
        nodes,
        nodes[-1].output[0],
        [],
        [helper.make_tensor_value_info(nodes[-1].output[0], TensorProto.FLOAT, ["n", 2])],
    )


def test_branches_within_branches(tmp_path):
    inner = op("If", ["no"], ["i"], then_branch=branch(op("Exp", ["action"], ["e"])),
               else_branch=branch(op("Tanh", ["action"], ["t"])))  # fmt: skip
    outer = op("If", ["yes"], ["velocity"], then_branch=branch(inner, op("Neg", ["i"], ["n"])),
               else_branch=branch(op("Sin", ["action"], ["s"])))  # fmt: skip
    model = read(graph_of(outer, constants={"yes": np.bool_(True), "no": np.bool_(False)}), tmp_path)
    kinds = [node.op_type for node in model.graph.node if node.op_type != "Identity"]
    assert kinds == ["Tanh", "Neg"]


THEN, ELSE = branch(op("Tanh", ["action"], ["a"])), branch(op("Sigmoid", ["action"], ["b"]))


def test_a_branch_that_the_batch_decides(tmp_path):
    nodes = [
        op("Shape", ["action"], ["s"]), op("Gather", ["s", "first"], ["size"]),
        op("Equal", ["size", "one"], ["c"]),
        op("If", ["c"], ["velocity"], then_branch=THEN, else_branch=ELSE),
    ]  # fmt: skip
    constants = {"first": np.int64(0), "one": np.int64(1)}
    assert "the branch of an If depends on the size of the batch" in refusal(
        graph_of(*nodes, constants=constants), tmp_path
    )


def test_a_branch_that_the_observation_decides_is_not_taken_for_a_constant(tmp_path):
    nodes = [
        op("ReduceSum", ["observation"], ["s"], keepdims=0), op("Greater", ["s", "zero"], ["c"]),
        op("If", ["c"], ["velocity"], then_branch=THEN, else_branch=ELSE),
    ]  # fmt: skip
    model = read(graph_of(*nodes, constants={"zero": np.float32(0)}), tmp_path)
    with pytest.raises(PolicyError, match="operator If cannot be differentiated"):
        with_jacobian(model)


def external(**entries):
    """The MLP, one of whose constants lies in another file."""
    model = mlp()
    tensor = TensorProto(
        name="w", data_type=TensorProto.FLOAT, dims=[5, 8], data_location=TensorProto.EXTERNAL
    )
    for key, value in entries.items():
        tensor.external_data.add(key=key, value=value)
    del model.graph.initializer[0]
    model.graph.initializer.append(tensor)
    return model


def test_constants_in_a_file_beside_the_graph(tmp_path):
    (tmp_path / "w.bin").write_bytes(W.tobytes())
    np.testing.assert_array_equal(read_flow_weights(read(external(location="w.bin"), tmp_path)).action, W[:2])


@pytest.mark.parametrize("entries", [
    {}, {"location": ""}, {"location": "."}, {"location": "../w.bin"}, {"location": "/etc/passwd"},
    {"location": "a\0b"}, {"location": "x" * 5000}, {"location": "none"},
    {"location": "w.bin", "offset": "99999999999"}, {"location": "w.bin", "offset": "-5"},
    {"location": "w.bin", "offset": "five"}, {"location": "w.bin", "offset": "9" * 5000},
    {"location": "w.bin", "length": "99999999999999"}, {"location": "w.bin", "length": "-1"},
])  # fmt: skip
def test_constants_in_files_that_are_not_there(tmp_path, entries):
    (tmp_path / "w.bin").write_bytes(W.tobytes())
    assert refusal(external(**entries), tmp_path).startswith("not a valid velocity graph (")


def changed(change):
    model = mlp()
    change(model.graph, model)
    return model


UNSOUND = {
    "an unknown type of an input": lambda g, _: setattr(g.input[0].type.tensor_type, "elem_type", 999),
    "an unknown type of a constant": lambda g, _: setattr(g.initializer[0], "data_type", 999),
    "a constant of no type": lambda g, _: setattr(g.initializer[0], "data_type", 0),
    "a constant of 32 TB": lambda g, _: g.initializer[0].dims.__setitem__(0, 10**12),
    "a constant of a negative size": lambda g, _: g.initializer[0].dims.__setitem__(0, -5),
    "a constant twice": lambda g, _: g.initializer.append(g.initializer[0]),
    "an input twice": lambda g, _: g.input.append(g.input[0]),
    "a name twice": lambda g, _: g.node.insert(1, g.node[0]),
    "no outputs": lambda g, _: g.ClearField("output"),
    "an output without a name": lambda g, _: setattr(g.output[0], "name", ""),
    "an output that nothing computes": lambda g, _: setattr(g.output[0], "name", "none"),
    "an output of another type": lambda g, _: setattr(g.output[0].type.tensor_type, "elem_type", 11),
    "no nodes": lambda g, _: g.ClearField("node"),
    "nodes without outputs": lambda g, _: g.node[1].ClearField("output"),
    "nodes out of order": lambda g, _: g.node.insert(0, g.node[2]),
    "an unknown operator": lambda g, _: setattr(g.node[1], "op_type", "None"),
    "an unknown domain": lambda g, _: setattr(g.node[1], "domain", "mine"),
    "an unknown attribute": lambda g, _: g.node[1].attribute.append(helper.make_attribute("none", 1)),
    "no opset": lambda _, m: m.ClearField("opset_import"),
    "an opset of 10^9": lambda _, m: setattr(m.opset_import[0], "version", 10**9),
    "an opset of -1": lambda _, m: setattr(m.opset_import[0], "version", -1),
}


@pytest.mark.parametrize("what", UNSOUND)
def test_graphs_that_are_not_sound(tmp_path, what):
    assert refusal(changed(UNSOUND[what]), tmp_path)


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
