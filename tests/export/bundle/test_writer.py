"""A bundle is written whole and in agreement with its source, or not at all."""

import dataclasses

import numpy as np
import pytest
from bundle_files import MANIFEST
from networks import random_weights

from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.policy.agreement import TOLERANCE
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.numpy_policy import FlowPolicy
from export.bundle import writer as bundle_writer
from export.bundle.facts import Facts
from export.bundle.parity import random_inputs, require_parity
from export.bundle.writer import bundle_draft, write_bundle
from export.onnx.graph import velocity_graph
from export.onnx.jacobian import with_jacobian

FACTS = Facts(MANIFEST.observation, MANIFEST.action, 10.0, 10, MANIFEST.motion, MANIFEST.body)
WEIGHTS = random_weights(hidden=(16, 16))
GRAPH = with_jacobian(velocity_graph(WEIGHTS))
INPUTS = random_inputs(FACTS)
EXPECTED = FlowPolicy(WEIGHTS, 10, 1000).evaluate(*INPUTS.arrays())


def write(target, graph=GRAPH, weights=WEIGHTS, expected=EXPECTED, facts=FACTS, **options):
    with bundle_draft(target, **options) as draft:
        return write_bundle(draft, facts, graph, weights, INPUTS, expected)


def contents(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def test_round_trip(tmp_path):
    difference = write(tmp_path / "policies" / "mine")
    assert 0 < difference < TOLERANCE
    loaded = load_bundle(tmp_path / "policies" / "mine")
    assert (loaded.manifest.name, loaded.manifest.runtime) == ("mine", "numpy")
    assert loaded.manifest.network.hidden == (16, 16)
    np.testing.assert_array_equal(loaded.policy(1000).evaluate(*INPUTS.arrays()), EXPECTED)
    assert [path.name for path in (tmp_path / "policies").iterdir()] == ["mine"]


def test_same_policy_gives_the_same_bytes(tmp_path):
    write(tmp_path / "a" / "mine")
    write(tmp_path / "b" / "mine")
    assert contents(tmp_path / "a" / "mine") == contents(tmp_path / "b" / "mine")


def perturbed(field):
    array = getattr(WEIGHTS, field).copy()
    array[0, 0] += 1e-3
    return dataclasses.replace(WEIGHTS, **{field: array})


@pytest.mark.parametrize("field", ["action", "observation", "time"])
def test_one_perturbed_weight_is_refused(tmp_path, field):
    other = perturbed(field)
    with pytest.raises(
        BundleError, match=r"velocity of the source and policy\.npz differ by .* no bundle is"
    ):
        write(tmp_path / "mine", weights=other)
    with pytest.raises(BundleError, match=r"of the source and policy\.onnx differ by"):
        write(tmp_path / "mine", graph=with_jacobian(velocity_graph(other)))
    assert not list(tmp_path.iterdir())


def test_jacobian_alone_is_compared_too(tmp_path):
    wrong = EXPECTED.copy()
    wrong[2, 17, 0] += 1e-4
    with pytest.raises(BundleError, match="jacobian of the source and"):
        write(tmp_path / "mine", expected=wrong)


def test_rounding_is_held_against_the_size_of_what_a_component_computes():
    large = np.full((3, 4, 2), 50.0)
    large[0, 0] = 0.0
    rounded = large.copy()
    rounded[0, 0, 1] = 5e-5
    assert require_parity({"a": large, "b": rounded}) < 2e-6
    rounded[0, 0, 1] = 1e-3
    with pytest.raises(BundleError, match="velocity of a and b differ by"):
        require_parity({"a": large, "b": rounded})
    small = large / 1e3
    with pytest.raises(BundleError, match="velocity of a and b differ by"):
        require_parity({"a": small, "b": small + 2e-5})


def test_nan_never_passes():
    nan = np.full_like(EXPECTED, np.nan)
    with pytest.raises(BundleError, match="differ by nan"):
        require_parity({"a": nan, "b": nan})


def test_manifest_that_no_robot_accepts_is_not_written(tmp_path):
    with pytest.raises(BundleError, match="control_rate_hz is 0"):
        write(
            tmp_path / "mine",
            facts=Facts(FACTS.observation, FACTS.action, 0.0, 10, FACTS.motion, FACTS.body),
        )
    assert not list(tmp_path.iterdir())


def test_existing_bundle_needs_force(tmp_path):
    write(tmp_path / "mine")
    before = contents(tmp_path / "mine")
    with pytest.raises(ConfigError, match="mine: exists already; --force replaces it"):
        write(tmp_path / "mine", weights=None)
    assert contents(tmp_path / "mine") == before
    write(tmp_path / "mine", weights=None, force=True)
    assert load_bundle(tmp_path / "mine").manifest.runtime == "onnxruntime"
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_force_replaces_nothing_but_bundles(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ConfigError, match="exists and is no bundle; name another directory"):
        write(tmp_path, force=True)
    assert (tmp_path / "thesis.tex").exists()


@pytest.mark.parametrize("stage", ["_write_files", "_checked", "load_bundle"])
def test_interrupted_export_leaves_the_old_bundle(tmp_path, monkeypatch, stage):
    write(tmp_path / "mine")
    before = contents(tmp_path / "mine")

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(bundle_writer, stage, interrupt)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "mine", force=True)
    assert contents(tmp_path / "mine") == before
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_target_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="mine: cannot be written"):
        write(tmp_path / "file" / "mine")
