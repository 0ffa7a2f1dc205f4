"""A bundle loads exactly as it was written, or not at all."""

import shutil
import subprocess

import msgspec
import numpy as np
import pytest
from bundle_files import MANIFEST, WEIGHTS, edit_manifest, sign, write_bundle
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_runtime.errors import BundleError
from edge_runtime.policy import bundle
from edge_runtime.policy.bundle import load_bundle, packaged_bundle
from edge_runtime.policy.flow_steps import flow_steps
from edge_runtime.policy.numpy_policy import FlowPolicy

SHA256SUM = shutil.which("sha256sum")
FILES = ("manifest.json", "manifest.sha256", "policy.npz", "policy.onnx")


@pytest.fixture
def directory(tmp_path):
    return write_bundle(tmp_path / "tiny")


def refusal(directory):
    with pytest.raises(BundleError) as caught:
        load_bundle(directory)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_round_trip(directory):
    loaded = load_bundle(directory)
    assert loaded.directory == directory
    assert loaded.manifest == msgspec.structs.replace(MANIFEST, files=loaded.manifest.files)
    for name in ("action", "observation", "time", "time_frequency", "time_phase", "matrices", "biases"):
        for ours, theirs in zip(getattr(loaded.weights, name), getattr(WEIGHTS, name), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert (loaded.weights.activation, loaded.weights.prior_std) == ("silu", 0.5)


def test_policy_follows_the_manifest_or_the_caller(directory):
    loaded = load_bundle(directory)
    assert isinstance(loaded.policy(), FlowPolicy)
    assert loaded.policy(batch=3).batch == 3
    assert loaded.policy().schedule == flow_steps("euler", 10, 0.5)
    assert loaded.sampled("exponential", 4).field().schedule == flow_steps("exponential", 4, 0.5)


def test_a_manifest_names_its_sampler_and_steps(directory):
    edit_manifest(directory, "sampler", "exponential")
    assert load_bundle(directory).policy().schedule == flow_steps("exponential", 10, 0.5)
    edit_manifest(directory, "sampler_steps", 3)
    assert load_bundle(directory).policy().schedule == flow_steps("exponential", 3, 0.5)


@pytest.mark.skipif(SHA256SUM is None, reason="sha256sum is not installed")
def test_sha256sum_accepts_the_digest_file(directory):
    command = [SHA256SUM, "-c", "manifest.sha256"]
    assert (
        subprocess.run(command, cwd=directory, check=True, capture_output=True).stdout
        == b"manifest.json: OK\n"
    )


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(FILES), position=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_any_flipped_bit_is_refused(directory, name, position, bit):
    path = directory / name
    intact = path.read_bytes()
    index = int(position * len(intact))
    path.write_bytes(intact[:index] + bytes([intact[index] ^ 1 << bit]) + intact[index + 1 :])
    try:
        assert "does not match its digest" in refusal(directory)
    finally:
        path.write_bytes(intact)


def test_every_byte_of_the_digest_file_counts(directory):
    path = directory / "manifest.sha256"
    intact = path.read_bytes()
    for index in range(len(intact)):
        path.write_bytes(intact[:index] + bytes([intact[index] ^ 0x20]) + intact[index + 1 :])
        assert "manifest.json: does not match its digest in manifest.sha256" in refusal(directory)


@pytest.mark.parametrize("name", FILES)
def test_missing_file_is_named(directory, name):
    (directory / name).unlink()
    assert refusal(directory).startswith(f"{directory / name}: cannot be read")


def test_missing_directory_is_named(tmp_path):
    assert "nowhere: no such bundle directory; edge-export writes one" in refusal(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"{", "truncated"),
        (b"\xff", "malformed"),
        (b'{"format": NaN}', "malformed"),
        (b"[]", "Expected `object`"),
    ],
)
def test_manifest_that_is_no_json_object(directory, content, complaint):
    sign(directory, content)
    message = refusal(directory)
    assert message.startswith(f"{directory / 'manifest.json'}: ")
    assert complaint in message


def test_packaged_bundles_are_listed(monkeypatch, tmp_path):
    monkeypatch.setattr(bundle, "PACKAGED", tmp_path)
    with pytest.raises(BundleError, match="'tiny' is not a packaged policy: none are installed"):
        packaged_bundle("tiny")
    write_bundle(tmp_path / "tiny")
    assert packaged_bundle("tiny").manifest.name == "tiny"
    with pytest.raises(BundleError, match=r"'\.\./tiny' is not a packaged policy: tiny"):
        packaged_bundle("../tiny")


def test_key_that_no_manifest_has(directory):
    edit_manifest(directory, "speed", 3)
    assert "speed: unknown key; allowed: format, name, runtime" in refusal(directory)
