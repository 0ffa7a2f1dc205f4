"""ONNX graphs over action, tau and observation: valid ones, and what is left when they are taken apart."""

import contextlib

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from velocity_graphs import graph_of

from edge_runtime.common.bounded_child import Bounds
from export.bundle.facts import read_facts
from export.bundle.facts_template import facts_template
from export.onnx.importing import import_graph
from hostile.values import change_bytes

BOUNDS = Bounds(seconds=4, memory_mib=160)
op = helper.make_node
DRAW = np.random.default_rng(0)
WEIGHTS = {
    "w": DRAW.normal(size=(5, 8)).astype(np.float32), "v": DRAW.normal(size=(8, 2)).astype(np.float32),
    "b": DRAW.normal(size=8).astype(np.float32), "one": np.float32(1.0), "yes": np.bool_(True),
}  # fmt: skip
CAT = op("Concat", ["action", "tau", "observation"], ["x"], axis=1)
KINDS = sorted({schema.name for schema in onnx.defs.get_all_schemas()})
INTEGERS = [0, 1, -1, 2, 3, 7, 10, 2**31, 2**62, -(2**62), 10**5, 10**9]


def branch(*nodes):
    name = nodes[-1].output[0]
    return helper.make_graph(nodes, name, [], [helper.make_tensor_value_info(name, TensorProto.FLOAT, None)])


def layers(activation):
    return [
        CAT, op("Gemm", ["x", "w", "b"], ["y"]), op(activation, ["y"], ["z"]),
        op("MatMul", ["z", "v"], ["velocity"]),
    ]  # fmt: skip


BASES = [
    layers("Tanh"),
    layers("Sigmoid"),
    layers("Erf"),
    [*layers("Tanh")[:-1], op("Gemm", ["z", "v", ""], ["velocity"], alpha=0.5)],
    [CAT, op("MatMul", ["x", "w"], ["y"]), op("Softmax", ["y"], ["p"]), op("Mul", ["p", "y"], ["z"]),
     op("MatMul", ["z", "v"], ["velocity"])],
    [CAT, op("Cast", ["x"], ["h"], to=10), op("Cast", ["h"], ["i"], to=1), op("MatMul", ["i", "w"], ["y"]),
     op("Tanh", ["y"], ["z"]), op("MatMul", ["z", "v"], ["velocity"])],
    [op("If", ["yes"], ["velocity"], then_branch=branch(op("Tanh", ["action"], ["a"])),
        else_branch=branch(op("Neg", ["action"], ["a2"])))],
    [op("Shape", ["action"], ["s"]), op("ConstantOfShape", ["s"], ["c"]), op("Tanh", ["action"], ["a"]),
     op("Add", ["a", "c"], ["velocity"])],
]  # fmt: skip


def prepare(folder):
    facts = facts_template().replace('["position", "velocity", "goal_offset", "proximity"]', '["position"]')
    (folder / "facts.toml").write_text(facts)
    return folder, read_facts(folder / "facts.toml")


def attempt(draw, given):
    folder, facts = given
    model = graph_of(*draw.choice(BASES), constants=WEIGHTS, opset=draw.choice([11, 13, 17, 17, 17, 20, 21]))
    for _ in range(draw.randrange(4)):
        with contextlib.suppress(IndexError):  # nothing is left of a kind
            change(draw, model)
    content = model.SerializeToString()
    path = folder / "case.onnx"
    path.write_bytes(change_bytes(draw, content) if draw.random() < 0.2 else content)
    import_graph(path, facts, folder / "out", force=True, bounds=BOUNDS)


def change(draw, model):
    graph = model.graph
    node, tensor = draw.choice(graph.node), draw.choice(graph.initializer)
    names = [*(name for each in graph.node for name in (*each.input, *each.output)), "action", "none", ""]
    match draw.randrange(16):
        case 0:
            node.op_type = draw.choice(KINDS)
        case 1 if node.input:
            node.input[draw.randrange(len(node.input))] = draw.choice(names)
        case 2:
            node.input.append(draw.choice(names))
        case 3 if node.output:
            node.output[draw.randrange(len(node.output))] = draw.choice(names)
        case 4 if len(graph.node) > 1:
            graph.node.remove(node)
        case 5:
            graph.node.insert(draw.randrange(len(graph.node)), node)
        case 6:
            tensor.data_type = draw.choice([*range(25), 999])
        case 7 if tensor.dims:
            tensor.dims[draw.randrange(len(tensor.dims))] = draw.choice(INTEGERS)
        case 8:
            tensor.CopyFrom(numpy_helper.from_array(np.array(draw.sample(INTEGERS, 2)), tensor.name))
        case 9:
            name, kind = (
                draw.choice(["axis", "to", "axes", "value", "alpha", "keepdims", "none"]),
                draw.randrange(4),
            )
            values = [draw.choice(INTEGERS), 0.5, [draw.choice(INTEGERS)] * 3, b"text"]
            node.attribute.append(helper.make_attribute(name, values[kind]))
        case 10:
            model.opset_import[0].version = draw.choice([-1, 0, 1, 6, 12, 18, 24, 1000, 2**62])
        case 11:
            model.ir_version = draw.choice([-1, 0, 1, 3, 4, 10, 99, 2**62])
        case 12:
            value = draw.choice([*graph.input, *graph.output])
            value.type.tensor_type.elem_type = draw.choice([*range(25), 999])
        case 13:
            value = draw.choice([*graph.input, *graph.output])
            value.type.tensor_type.shape.dim.add(dim_value=draw.choice(INTEGERS))
        case 14:
            tensor.data_location = TensorProto.EXTERNAL
            for key, texts in (
                ("location", ["", "x", "../x", "/etc/passwd", "."]),
                ("offset", ["-1", "9" * 30, "x"]),
            ):
                tensor.external_data.add(key=key, value=draw.choice(texts))
        case _:
            values = draw.choice([graph.input, graph.output, graph.initializer])
            values.append(draw.choice(values)) if draw.random() < 0.5 else values.pop()
