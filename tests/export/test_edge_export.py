"""edge-export from its command line: runs, foreign graphs, and one line for every mistake."""

import os
import re
import resource
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from torch import nn
from velocity_graphs import graph_of
from velocity_nets import Mlp, Normed, autograd, export

from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.signature import check_signature, read_signature
from export import edge_export as export_policy
from export.algorithms.networks import FlowNetwork
from export.bundle.facts_template import facts_template
from export.training.checkpoint import PolicyFacts, save_policy

FACTS = facts_template().replace("lidar_rays = 12", "lidar_rays = 1")
"""Observations of seven numbers, as `velocity_nets.OBSERVATION`."""


@pytest.fixture
def edge_export(monkeypatch, capsys):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["edge-export", *map(str, arguments)])
        code = export_policy.main()
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def training_run(tmp_path):
    torch.manual_seed(0)
    network = FlowNetwork(18, 2, (16, 16))
    for parameter in network.parameters():
        nn.init.normal_(parameter, std=0.3)
    save_policy(tmp_path, network, PolicyFacts("navigation", "mafpo", 3, 1000, "abc", 0.9, 8))
    return tmp_path, network


@pytest.fixture
def facts(tmp_path):
    path = tmp_path / "facts.toml"
    path.write_text(FACTS)
    return path


def reported_difference(output):
    return float(re.search(r"largest difference .*: (\S+) over 1000 random inputs", output)[1])


def test_training_run(edge_export, training_run, tmp_path):
    run, network = training_run
    code, output, _ = edge_export(run, "--out", tmp_path / "nav")
    assert code == 0
    assert 0 < reported_difference(output) < 1e-5
    bundle = load_bundle(tmp_path / "nav")
    assert (bundle.manifest.training.seed, bundle.manifest.training.score) == (3, 0.9)
    assert all(field.seen for field in bundle.manifest.observation)
    assert (bundle.manifest.euler_steps, bundle.manifest.control_rate_hz) == (8, 10.0)
    action, tau, observation = torch.randn(5, 2), torch.rand(5, 1), torch.randn(5, 18)
    velocity, jacobian = autograd(network, action, tau, observation)
    computed = bundle.policy(5).evaluate(action, tau[:, 0], observation)
    np.testing.assert_allclose(computed[0], velocity, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(np.moveaxis(computed[1:], 0, 2), jacobian, rtol=1e-5, atol=1e-5)


def test_a_bundle_takes_another_sampler(edge_export, training_run, tmp_path):
    edge_export(training_run[0], "--out", tmp_path / "nav")
    before = load_bundle(tmp_path / "nav")
    code, output, _ = edge_export("--resample", tmp_path / "nav", "--exponential-steps", 3)
    after = load_bundle(tmp_path / "nav")
    assert code == 0
    assert "integrated exponentially, in 3 steps" in output
    assert (after.manifest.sampler, after.manifest.steps, after.manifest.euler_steps) == ("exponential", 3, 8)
    assert after.stands_for(before.sha256)
    assert "go together" in refused(edge_export, "--resample", tmp_path / "nav")


def test_run_of_another_shape(edge_export, tmp_path):
    save_policy(tmp_path, FlowNetwork(24, 2), PolicyFacts("navigation", "mafpo", 3, 1000, "abc", 0.9, 8))
    error = refused(edge_export, tmp_path, "--out", tmp_path / "b")
    assert "takes 24 numbers and returns 2, its scenario now has 18 and 2: train it again" in error


@pytest.mark.parametrize(
    ("build", "runtime"), [(Mlp, "numpy"), (Normed, "onnxruntime"), (lambda: Normed(nn.ReLU), "onnxruntime")]
)
def test_foreign_graph(edge_export, facts, tmp_path, build, runtime):
    net = build()
    graph = export(net, tmp_path / "net.onnx")
    code, output, _ = edge_export("--from-onnx", graph, "--facts", facts, "--out", tmp_path / "mine")
    assert code == 0
    assert f"the robot computes it with {runtime}" in output
    assert "what it saw in training is not known" in output
    bundle = load_bundle(tmp_path / "mine")
    assert (bundle.manifest.runtime, bundle.policy().backend) == (runtime, runtime)
    action, tau, observation = torch.randn(5, 2), torch.rand(5, 1), torch.randn(5, 7)
    velocity, jacobian = autograd(net, action, tau, observation)
    computed = bundle.policy(5).evaluate(action, tau[:, 0], observation)
    np.testing.assert_allclose(computed[0], velocity, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(np.moveaxis(computed[1:], 0, 2), jacobian, rtol=1e-5, atol=1e-5)


def refused(edge_export, *arguments):
    code, output, error = edge_export(*arguments)
    assert (code, output) == (2, "")
    assert error.startswith("edge-export: ")
    assert error.count("\n") == 1
    return error


def test_graph_that_mixes_its_batch(edge_export, facts, tmp_path):
    mean = onnx.helper.make_node("ReduceMean", ["action"], ["m"], axes=[0])
    add = onnx.helper.make_node("Sub", ["action", "m"], ["velocity"])
    onnx.save(graph_of(mean, add), tmp_path / "net.onnx")
    facts.write_text(FACTS.replace('["position", "velocity", "goal_offset", "proximity"]', '["position"]'))
    error = refused(
        edge_export, "--from-onnx", tmp_path / "net.onnx", "--facts", facts, "--out", tmp_path / "b"
    )
    assert "a batch and a single input differ" in error


def test_graph_with_a_batch_baked_in(edge_export, facts, tmp_path):
    reshape = onnx.helper.make_node("Reshape", ["action", "shape"], ["velocity"])
    onnx.save(graph_of(reshape, constants={"shape": [3, 2]}), tmp_path / "net.onnx")
    facts.write_text(FACTS.replace('["position", "velocity", "goal_offset", "proximity"]', '["position"]'))
    error = refused(
        edge_export, "--from-onnx", tmp_path / "net.onnx", "--facts", facts, "--out", tmp_path / "b"
    )
    assert "cannot be computed for a batch of 2000" in error
    assert "dynamic batch" in error


def test_mistakes_on_the_command_line(edge_export, training_run, facts, tmp_path):
    run, _ = training_run
    out = tmp_path / "b"
    assert "--out DIR is missing" in refused(edge_export, run)
    assert "either a training run or --from-onnx FILE" in refused(edge_export, "--out", out)
    assert "either a training run" in refused(edge_export, run, "--from-onnx", "x.onnx", "--out", out)
    assert "--from-onnx needs --facts FILE" in refused(edge_export, "--from-onnx", "x.onnx", "--out", out)
    assert "--facts goes with --from-onnx" in refused(edge_export, run, "--facts", facts, "--out", out)
    assert "--calibration goes with" in refused(edge_export, run, "--calibration", "x.npz", "--out", out)
    assert "--seen DIR changes a bundle" in refused(edge_export, "--seen", run, "--out", out)
    assert "--upgrade DIR changes a bundle" in refused(edge_export, "--upgrade", run, "--sign", facts)
    assert "--seen DIR changes a bundle" in refused(edge_export, "--seen", run, "--resample", run)
    assert "name the --out directory of an edge-train run" in refused(edge_export, out, "--out", out)
    assert not out.exists()


def test_facts_template_is_printed_as_it_is(edge_export):
    assert edge_export("--print-facts-template") == (0, facts_template() + "\n", "")


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "release.key"
    path.write_text("5a" * 32)
    path.chmod(0o600)
    return path


def test_a_bundle_is_signed_and_counted_on(edge_export, training_run, tmp_path, key):
    run, _ = training_run
    target = tmp_path / "nav"
    code, output, _ = edge_export(run, "--out", target, "--sign", key)
    assert code == 0
    first = check_signature(target, load_bundle(target).sha256, (read_signature(target).key,))
    assert first.version == 1
    assert f'trusted_keys = ["{first.key}"]' in output
    assert edge_export(run, "--out", target, "--force", "--sign", key)[0] == 0
    assert read_signature(target).version == 2
    assert edge_export("--out", target, "--sign", key, "--bundle-version", 9)[0] == 0
    assert read_signature(target).version == 9


@pytest.mark.parametrize(("flags", "said"), [
    (["--sign", "none.key"], "create it with"),
    (["--bundle-version", "2"], "--bundle-version goes with --sign"),
])  # fmt: skip
def test_what_cannot_be_signed_is_not_exported(edge_export, training_run, tmp_path, flags, said):
    code, _, complaint = edge_export(training_run[0], "--out", tmp_path / "nav", *flags)
    assert code == 2 and said in complaint
    assert not (tmp_path / "nav").exists()


def test_a_graph_says_what_it_saw_by_a_calibration_file(edge_export, facts, tmp_path):
    seen = np.random.default_rng(0).normal(size=(9, 7)).astype(np.float32)
    np.savez(tmp_path / "seen.npz", observation=seen)
    graph = export(FlowNetwork(7, 2, (8, 8)), tmp_path / "net.onnx")
    flags = ("--facts", facts, "--calibration", tmp_path / "seen.npz", "--out", tmp_path / "mine")
    code, output, _ = edge_export("--from-onnx", graph, *flags)
    assert code == 0
    assert "not known" not in output
    fields = load_bundle(tmp_path / "mine").manifest.observation
    pairs = np.array([pair for field in fields for pair in field.seen])
    np.testing.assert_array_equal(pairs.T, [seen.min(0), seen.max(0)])


ODD = {
    "nothing": Path.exists,
    "a folder": lambda path: path.mkdir(),
    "no bytes": lambda path: path.touch(),
    "noise": lambda path: path.write_bytes(bytes(range(256))),
    "text": lambda path: path.write_text("hello\n"),
    "a link to itself": lambda path: path.symlink_to(path),
    "a pipe": os.mkfifo,
    "a file without end": lambda path: path.symlink_to("/dev/zero"),
    "three gigabytes": lambda path: (path.touch(), os.truncate(path, 3 << 30)),
}
READ = [
    "odd --out out",
    "--from-onnx odd --facts facts.toml --out out",
    "--from-onnx net.onnx --facts odd --out out",
    "--from-onnx net.onnx --facts facts.toml --calibration odd --out out",
    "--upgrade odd",
    "--seen odd",
    "--resample odd --exponential-steps 3",
    ". --out out --sign odd",
    "--out odd --sign release.key",
]


def everything(folder):
    return sorted((path, path.lstat().st_mtime_ns) for path in folder.rglob("*"))


@pytest.mark.parametrize("flags", READ)
@pytest.mark.usefixtures("training_run", "facts", "key")
def test_whatever_a_path_leads_to_is_one_line_and_nothing_is_left(edge_export, tmp_path, monkeypatch, flags):
    monkeypatch.chdir(tmp_path)
    export(FlowNetwork(7, 2, (8, 8)), "net.onnx")
    for make in ODD.values():
        make(tmp_path / "odd")
        before = everything(tmp_path)
        assert "odd" in refused(edge_export, *flags.split())
        assert everything(tmp_path) == before
        remove(tmp_path / "odd")
    assert "x" * 300 in refused(edge_export, *flags.replace("odd", "x" * 300).split())
    assert not (tmp_path / "out").exists()


def remove(path):
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    else:
        path.unlink(missing_ok=True)


@pytest.mark.parametrize("out", ["odd", "odd/out", "/proc/out", "/dev/full", "/", "x" * 300])
@pytest.mark.usefixtures("training_run")
def test_what_cannot_be_the_bundles_folder_is_one_line(edge_export, tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "odd").touch()
    before = everything(tmp_path)
    assert out in refused(edge_export, ".", "--out", out)
    assert everything(tmp_path) == before


def test_a_full_disk_leaves_the_bundle_that_was_there(edge_export, training_run, tmp_path):
    target = tmp_path / "nav"
    target.mkdir()
    (target / "manifest.json").touch()
    before = everything(tmp_path)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
    try:
        error = refused(edge_export, training_run[0], "--out", target, "--force")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert f"{target}: cannot be written (File too large)" in error
    assert everything(tmp_path) == before
