"""The policy over onnxruntime keeps the interface of the numpy policy and says what it lacks."""

import sys

import numpy as np
import onnx
import pytest
from networks import random_weights

from edge_runtime.errors import PolicyError
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.onnx_policy import OnnxPolicy
from export.onnx.graph import velocity_graph
from export.onnx.jacobian import with_jacobian


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
    assert (ours.backend, ours.batch, ours.euler_steps) == ("onnxruntime", 3, 7)
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
