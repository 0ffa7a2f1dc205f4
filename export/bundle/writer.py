"""Write a policy bundle: completely, checked by the robot's own loader, or not at all."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
from onnx import ModelProto

from edge_runtime.common.arrays import Floats
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import DIGEST_FILE, MANIFEST_FILE, Bundle, digest_line, load_bundle
from edge_runtime.policy.manifest import Manifest, Network
from edge_runtime.policy.schema import GRAPH_FILE, WEIGHTS_FILE
from edge_runtime.policy.weight_file import pack_weights
from edge_runtime.policy.weights import FlowWeights
from export.bundle.facts import Facts
from export.bundle.parity import Inputs, require_parity


@contextlib.contextmanager
def bundle_draft(target: Path, *, force: bool = False) -> Iterator[Path]:
    """Yield an empty directory that becomes the bundle ``target`` at the end, unless an error ends it.

    Args:
        target: the bundle's directory.
        force: replace an existing bundle.

    Raises:
        ConfigError: if ``target`` exists and is no bundle or ``force`` is not set, or cannot be written.
    """
    target = Path(os.path.realpath(target))
    try:
        _require_replaceable(target, force)
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as scratch:
            draft = Path(scratch) / target.name
            draft.mkdir()
            yield draft
            _replace(target, draft, Path(scratch) / ".replaced")
    except OSError as error:
        raise ConfigError(f"{target}: cannot be written ({error.strerror or error})") from error


def write_bundle(
    draft: Path,
    facts: Facts,
    graph: ModelProto,
    weights: FlowWeights | None,
    inputs: Inputs,
    expected: Floats,
) -> float:
    """Write a bundle whose forms agree.

    Args:
        draft: an empty directory; its last part names the policy.
        facts: what the manifest says of fields, motion and origin.
        graph: velocity and Jacobian.
        weights: the same field for the numpy runtime; None where only onnxruntime can compute it.
        inputs: where the forms are compared.
        expected: (1 + d, B, d) what the source of the policy computes there.

    Returns:
        The largest difference between source, graph and weights.

    Raises:
        BundleError: if the forms differ, or the robot could not load the bundle.
        OSError: if a file cannot be written.
    """
    _write_files(draft, facts, graph, weights)
    return _checked(load_bundle(draft), inputs, expected)


def _write_files(draft: Path, facts: Facts, graph: ModelProto, weights: FlowWeights | None) -> None:
    contents = {GRAPH_FILE: graph.SerializeToString(deterministic=True)}
    network = None
    if weights is not None:
        contents[WEIGHTS_FILE] = pack_weights(weights)
        network = Network(weights.activation, weights.hidden, weights.prior_std)
    digests = {file: hashlib.sha256(content).hexdigest() for file, content in contents.items()}
    for file, content in contents.items():
        (draft / file).write_bytes(content)
    write_manifest(draft, facts.manifest(draft.name, network, digests))


def write_manifest(directory: Path, manifest: Manifest) -> None:
    """Write a bundle's manifest, and the digest of it; the files that it names are there already."""
    encoded = msgspec.json.format(msgspec.json.encode(manifest)) + b"\n"
    (directory / MANIFEST_FILE).write_bytes(encoded)
    (directory / DIGEST_FILE).write_bytes(digest_line(encoded))


def _checked(bundle: Bundle, inputs: Inputs, expected: Floats) -> float:
    batch = len(inputs.tau)
    graph = bundle.graph_policy(batch)
    results = {"the source": expected, GRAPH_FILE: graph.evaluate(*inputs.arrays())}
    if bundle.weights is not None:
        results[WEIGHTS_FILE] = bundle.policy(batch).evaluate(*inputs.arrays())
    difference = require_parity(results)
    # A robot computes one input at a time, which must not depend on the others of a batch.
    alone = bundle.policy(batch=1).evaluate(*inputs.select(np.array([0])).arrays())
    return max(difference, require_parity({"a batch": expected[:, :1], "a single input": alone}))


def _require_replaceable(target: Path, force: bool) -> None:
    if not target.exists():
        return
    if not (target / MANIFEST_FILE).is_file():
        raise ConfigError(f"{target}: exists and is no bundle; name another directory")
    if not force:
        raise ConfigError(f"{target}: exists already; --force replaces it")


def _replace(target: Path, draft: Path, replaced: Path) -> None:
    """Renaming is the last step: an interrupted export leaves no half-written bundle."""
    if not target.exists():
        draft.rename(target)
        return
    target.rename(replaced)
    try:
        draft.rename(target)
    except OSError:
        replaced.rename(target)
        raise
