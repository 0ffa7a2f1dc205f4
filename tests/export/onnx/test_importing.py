"""A foreign graph becomes a bundle, or one line, within its bounds."""

import numpy as np
import pytest
from onnx import TensorProto, helper
from velocity_graphs import graph_of
from velocity_nets import Mlp, export

from edge_runtime.common.bounded_child import Bounds
from edge_runtime.errors import PolicyError
from edge_runtime.policy.bundle import load_bundle
from export.bundle.facts import read_facts
from export.bundle.facts_template import facts_template
from export.onnx.importing import import_graph

op = helper.make_node
BOUNDS = Bounds(seconds=60, memory_mib=512)


@pytest.fixture
def facts(tmp_path):
    (tmp_path / "facts.toml").write_text(
        facts_template().replace('["position", "velocity", "goal_offset", "proximity"]', '["position"]')
    )
    return read_facts(tmp_path / "facts.toml")


def refusal(model, tmp_path, facts, bounds=BOUNDS):
    file, out = tmp_path / "net.onnx", tmp_path / "out"
    file.write_bytes(model if isinstance(model, bytes) else model.SerializeToString())
    with pytest.raises(PolicyError) as caught:
        import_graph(file, facts, out / "mine", bounds=bounds)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{file}: ")
    assert list(out.iterdir()) == []
    return message.removeprefix(f"{file}: ")


def test_a_sound_graph(tmp_path):
    (tmp_path / "facts.toml").write_text(facts_template().replace("lidar_rays = 12", "lidar_rays = 1"))
    graph = export(Mlp(), tmp_path / "net.onnx")
    imported = import_graph(graph, read_facts(tmp_path / "facts.toml"), tmp_path / "out" / "mine")
    assert imported.how == "numpy"
    assert 0 < imported.difference < 1e-5
    assert load_bundle(tmp_path / "out" / "mine").manifest.name == "mine"


def counting(trips):
    """A loop over constants that adds one so many times."""

    def info(name, kind, shape=()):
        return helper.make_tensor_value_info(name, kind, shape)

    body = helper.make_graph(
        [op("Identity", ["go"], ["on"]), op("Add", ["a", "one"], ["b"])], "body",
        [info("i", TensorProto.INT64), info("go", TensorProto.BOOL), info("a", TensorProto.FLOAT, [2])],
        [info("on", TensorProto.BOOL), info("b", TensorProto.FLOAT, [2])],
    )  # fmt: skip
    constants = {"n": np.int64(trips), "yes": np.bool_(True), "zero": np.zeros(2, np.float32),
                 "one": np.ones(2, np.float32)}  # fmt: skip
    nodes = [op("Loop", ["n", "yes", "zero"], ["l"], body=body), op("Add", ["action", "l"], ["velocity"])]
    return graph_of(*nodes, constants=constants)


def test_a_loop_of_a_thousand_million(tmp_path, facts):
    told = refusal(counting(10**9), tmp_path, facts, Bounds(seconds=2, memory_mib=512))
    assert told.startswith(("takes longer than 4 s", "takes more than 2 s"))


@pytest.mark.parametrize("shape", [[10**11], [10**6, 10**6]])
def test_a_constant_of_many_gigabytes(tmp_path, facts, shape):
    nodes = [
        op("ConstantOfShape", ["n"], ["l"]), op("ReduceSum", ["l"], ["s"], keepdims=0),
        op("Add", ["action", "s"], ["velocity"]),
    ]  # fmt: skip
    told = refusal(graph_of(*nodes, constants={"n": shape}), tmp_path, facts)
    assert told == "takes more than 512 MiB of memory"


def test_functions_that_double_forty_times(tmp_path, facts):
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("mine", 1)]
    model = graph_of(op("F0", ["action"], ["velocity"], domain="mine"))
    for depth in range(40):
        calls = [op(f"F{depth + 1}", [x], [y], domain="mine") for x, y in (("x", "a"), ("a", "y"))]
        model.functions.append(helper.make_function("mine", f"F{depth}", ["x"], ["y"], calls, opsets))
    last = helper.make_function("mine", "F40", ["x"], ["y"], [op("Tanh", ["x"], ["y"])], opsets[:1])
    model.functions.append(last)
    model.opset_import.append(opsets[1])
    assert refusal(model, tmp_path, facts, Bounds(seconds=2, memory_mib=512))


def test_a_complaint_without_an_end_is_cut(tmp_path, facts):
    model = graph_of(op("Tanh", ["action"], ["velocity"]))
    for number in range(20_000):
        model.graph.input.add(name=f"input \x1b[2J {number}")
    told = refusal(model, tmp_path, facts)
    assert told.startswith("has inputs action, tau, observation, input ?[2J 0, ")
    assert len(told) < 2100


def test_no_graph(tmp_path, facts):
    assert refusal(b"\0" * 1000, tmp_path, facts).startswith("not an ONNX file (")
