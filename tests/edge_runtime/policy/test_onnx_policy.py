"""The policy over onnxruntime keeps the interface of the numpy policy and says what it lacks."""

import sys

import numpy as np
import onnx
import pytest
from bundle_files import MANIFEST, write_bundle
from msgspec.structs import replace
from networks import random_weights
from onnx import TensorProto, helper
from velocity_graphs import graph_of

from edge_runtime.common.bounded_child import Bounds
from edge_runtime.errors import PolicyError
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.onnx_policy import OnnxPolicy
from edge_runtime.policy.onnx_trial import try_graph
from export.onnx.graph import velocity_graph
from export.onnx.jacobian import with_jacobian

ONNX_MANIFEST = replace(MANIFEST, runtime="onnxruntime", network=None, observation=MANIFEST.observation[:1])


@pytest.fixture(scope="module")
def weights():
    return random_weights()


@pytest.fixture(scope="module")
def graph(weights, tmp_path_factory):
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    onnx.save(with_jacobian(velocity_graph(weights)), path)
    return path


def test_steps_like_the_numpy_policy(weights, graph):
    draw = np.random.default_rng(0)
    theirs, ours = FlowPolicy(weights, 7, 3), OnnxPolicy(graph, 2, 18, 7, 3)
    assert (ours.backend, ours.batch, len(ours.schedule)) == ("onnxruntime", 3, 7)
    assert (ours.action_dim, ours.observation_dim) == (2, 18)
    for k in range(7):
        action, observation = draw.normal(size=(3, 2)), draw.normal(size=(3, 18))
        theirs.observe(observation)
        ours.observe(observation)
        np.testing.assert_allclose(ours.step(k, action), theirs.step(k, action), rtol=5e-6, atol=5e-6)


def test_the_callers_observation_may_change_after_observe(graph):
    policy, observation = OnnxPolicy(graph, 2, 18, 10), np.zeros((1, 18), np.float32)
    policy.observe(observation)
    before = policy.step(0, np.zeros((1, 2))).copy()
    observation[:] = 5.0
    np.testing.assert_array_equal(policy.step(0, np.zeros((1, 2))), before)


def test_missing_onnxruntime_tells_how_to_install_it(graph, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(PolicyError, match=r"needs onnxruntime, pip install 'cfpg-edge\[onnx\]'"):
        OnnxPolicy(graph, 2, 18, 10)


@pytest.mark.parametrize(("steps", "batch"), [(0, 1), (1, 0)])
def test_numbers_below_one(graph, steps, batch):
    with pytest.raises(PolicyError, match="must be at least 1"):
        OnnxPolicy(graph, 2, 18, steps, batch)


def test_wrong_observation_shape(graph):
    with pytest.raises(PolicyError, match=r"observation has shape \(18,\), this policy takes \(1, 18\)"):
        OnnxPolicy(graph, 2, 18, 10).observe(np.zeros(18))


def test_graph_of_another_robot(graph):
    with pytest.raises(PolicyError, match=r"has inputs .*'observation': 18.*need .*'observation': 16"):
        OnnxPolicy(graph, 2, 16, 10)


def test_graph_without_jacobian(weights, tmp_path):
    onnx.save(velocity_graph(weights), tmp_path / "policy.onnx")
    with pytest.raises(PolicyError, match=r"has outputs \['velocity'\], needs velocity and jacobian"):
        OnnxPolicy(tmp_path / "policy.onnx", 2, 18, 10)


def test_no_graph_at_all(tmp_path):
    (tmp_path / "policy.onnx").write_bytes(b"a graph")
    with pytest.raises(PolicyError, match=r"policy\.onnx: onnxruntime cannot load it"):
        OnnxPolicy(tmp_path / "policy.onnx", 2, 18, 10)


def test_a_graph_that_fails_on_the_way_is_one_line(graph, monkeypatch):
    policy = OnnxPolicy(graph, 2, 18, 10)

    class Failing:
        def run(self, outputs, inputs):
            raise RuntimeError("Non-zero status code\nand more")

    monkeypatch.setattr(policy, "_session", Failing())
    with pytest.raises(PolicyError, match=r"policy\.onnx: cannot be computed .*\(Non-zero status code\)$"):
        policy.step(3, np.zeros((1, 2)))


def test_a_hostile_graph_of_a_bundle_takes_neither_the_robots_time_nor_its_memory(tmp_path):
    nodes = [
        helper.make_node("Shape", ["action"], ["s"]),
        helper.make_node("Mul", ["s", "n"], ["m"]),
        helper.make_node("ConstantOfShape", ["m"], ["l"]),
        helper.make_node("ReduceSum", ["l"], ["z"], keepdims=0),
        helper.make_node("Tanh", ["action"], ["t"]),
        helper.make_node("Add", ["t", "z"], ["velocity"]),
    ]
    model = with_jacobian(graph_of(*nodes, constants={"n": np.array([10**5, 10**5])}))
    directory = write_bundle(tmp_path / "mine", graph=model.SerializeToString(), manifest=ONNX_MANIFEST)
    with pytest.raises(PolicyError, match=r"policy\.onnx: cannot be computed for a batch of 1 \("):
        load_bundle(directory).field()
    with pytest.raises(PolicyError, match=r"slow\.onnx: takes (more|longer) than \d s"):
        try_graph(write_slow(tmp_path / "slow.onnx"), 2, 2, Bounds(seconds=1, memory_mib=512))


def write_slow(path):
    """A loop of a thousand million within a graph that fits."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Tanh", ["a"], ["b"])],
        "body",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("a", TensorProto.FLOAT, ["batch", 2]),
        ],
        [
            helper.make_tensor_value_info("on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("b", TensorProto.FLOAT, ["batch", 2]),
        ],
    )
    model = with_jacobian(
        graph_of(
            helper.make_node("Loop", ["n", "yes", "observation"], ["l"], body=body),
            helper.make_node("Add", ["action", "l"], ["velocity"]),
            constants={"n": np.int64(10**9), "yes": np.bool_(True)},
        )
    )
    onnx.save(model, path)
    return path
