"""What the doctor says of a policy: recomputed here, on everything that can compute it."""

import dataclasses
import importlib.util
from pathlib import Path

import pytest
from bundle_files import MANIFEST, write_bundle
from networks import needs_kernel

import edge_runtime.policy.bundle
from edge_runtime.doctor import policy as doctor_policy
from edge_runtime.doctor.finding import Verdict, examine
from edge_runtime.doctor.policy import backend, bundle, parity
from edge_runtime.errors import PolicyError
from edge_runtime.policy.bundle import Bundle, load_bundle, packaged_bundle


@pytest.fixture(scope="module")
def packaged():
    return packaged_bundle("navigation")


def test_the_bundle_is_named_with_its_files(packaged):
    assert bundle(packaged).detail.startswith(f"navigation in {packaged.directory}: manifest and 2 files")


def test_the_packaged_policy_has_parity(packaged):
    pytest.importorskip("onnxruntime")
    found = parity(packaged)
    assert found.verdict is Verdict.OK
    assert "on 64 random inputs" in found.detail


@pytest.mark.parametrize("by", [1e-3, float("nan")])
def test_weights_that_differ_from_the_graph_fail(packaged, by):
    pytest.importorskip("onnxruntime")
    biases = packaged.weights.biases
    changed = dataclasses.replace(packaged.weights, biases=(*biases[:-1], biases[-1] + by))
    assert parity(dataclasses.replace(packaged, weights=changed)).verdict is Verdict.FAIL


def test_a_graph_that_cannot_be_computed_fails(tmp_path):
    pytest.importorskip("onnxruntime")
    damaged = load_bundle(write_bundle(tmp_path / "tiny"))
    found = examine("parity", lambda: parity(damaged))
    assert found.verdict is Verdict.FAIL
    assert "policy.onnx" in found.detail


def test_without_onnxruntime_nothing_is_claimed(packaged, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    found = parity(packaged)
    assert (found.verdict, found.detail) == (Verdict.WARN, "numpy was not compared with the graph")


@needs_kernel
def test_the_kernel_is_compared(packaged):
    assert backend(packaged, "auto").detail.endswith("agrees with numpy")


@pytest.fixture
def no_kernel(monkeypatch):
    def make_policy(*_arguments, **_options):
        raise PolicyError("the compiled kernel was not built")

    monkeypatch.setattr(edge_runtime.policy.bundle, "make_policy", make_policy)


@pytest.mark.usefixtures("no_kernel")
def test_a_missing_kernel_is_slow_and_no_more(packaged):
    found = backend(packaged, "auto")
    assert found.verdict is Verdict.WARN
    assert "numpy takes over" in found.detail


@pytest.mark.usefixtures("no_kernel")
def test_a_missing_kernel_that_was_asked_for_fails(packaged):
    assert examine("backend", lambda: backend(packaged, "compiled")).verdict is Verdict.FAIL


def test_numpy_alone_needs_no_kernel(packaged):
    assert backend(packaged, "numpy").detail == "numpy, as asked for"


def test_a_policy_for_onnxruntime_alone_has_nothing_to_compare(packaged):
    pytest.importorskip("onnxruntime")
    assert "nothing to compare" in parity(dataclasses.replace(packaged, weights=None)).detail


def test_a_missing_graph_is_named():
    lost = Bundle(MANIFEST, None, Path("/nowhere"))
    assert "/nowhere/policy.onnx" in examine("parity", lambda: parity(lost)).detail


def test_every_check_is_made_and_named(packaged):
    mission = type("M", (), {"bundle": packaged, "backend": "auto"})
    assert [finding.name for finding in doctor_policy.examine_policy(mission)] == [
        "bundle",
        "parity",
        "backend",
    ]
