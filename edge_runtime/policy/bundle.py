"""Load a policy bundle, a directory of ``manifest.json``, ``policy.onnx`` and the files around them.

``manifest.sha256`` holds the manifest's digest as ``sha256sum`` prints it, the manifest those of the
other files: a changed byte anywhere is refused before anything is computed.
"""

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from msgspec import structs

from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import BundleError, PolicyError
from edge_runtime.policy.backend import Backend, make_policy
from edge_runtime.policy.flow_steps import SamplerName
from edge_runtime.policy.manifest import Manifest
from edge_runtime.policy.manifest_file import read_manifest
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.onnx_policy import OnnxPolicy
from edge_runtime.policy.onnx_trial import try_graph
from edge_runtime.policy.schema import GRAPH_FILE, LARGEST_FILE, WEIGHTS_FILE, check_manifest
from edge_runtime.policy.velocity_field import VelocityField
from edge_runtime.policy.weight_file import unpack_weights
from edge_runtime.policy.weights import FlowWeights

MANIFEST_FILE: Final = "manifest.json"
DIGEST_FILE: Final = "manifest.sha256"
LARGEST_MANIFEST: Final = 1 << 20
PACKAGED: Final = Path(__file__).parents[1] / "bundles"


@dataclass(frozen=True)
class Bundle:
    """A verified policy bundle."""

    manifest: Manifest
    weights: FlowWeights | None
    """None where the manifest's runtime is ``onnxruntime``."""
    directory: Path
    sha256: str = ""
    """Of its manifest.json, which holds the digests of its other files."""

    def stands_for(self, sha256: str) -> bool:
        """Whether it is the bundle of this manifest, or the same policy under a later one."""
        return sha256 == self.sha256 or sha256 in self.manifest.supersedes

    def sampled(self, sampler: SamplerName, steps: int) -> "Bundle":
        """The same policy, its flow integrated otherwise than its manifest says."""
        return replace(self, manifest=structs.replace(self.manifest, sampler=sampler, sampler_steps=steps))

    def policy(self, batch: int = 1) -> FlowPolicy | OnnxPolicy:
        """Prepare the reference for ``batch`` observations at once: what parity is judged by.

        Args:
            batch: B, the number of observations computed together.

        Raises:
            PolicyError: if a number is below one, or onnxruntime is needed and not installed.
        """
        if self.weights is None:
            return self.graph_policy(batch)
        return FlowPolicy(self.weights, self.manifest.steps, batch, self.manifest.sampler)

    def field(self, backend: Backend = "auto") -> VelocityField:
        """Prepare the policy of a control loop on the backend asked for.

        Raises:
            PolicyError: as `make_policy`, or if a backend is asked for and only onnxruntime can run the
                policy.
        """
        if self.weights is not None:
            return make_policy(self.weights, self.manifest.steps, 1, self.manifest.sampler, backend)
        if backend != "auto":
            raise PolicyError(f"{self.directory}: this policy runs in onnxruntime only, not in {backend}")
        return self.policy()

    def graph_policy(self, batch: int = 1) -> OnnxPolicy:
        """Prepare the policy's graph for onnxruntime, whatever runtime the manifest prefers; as `policy`."""
        manifest, graph = self.manifest, self.directory / GRAPH_FILE
        sizes = (manifest.action_dim, manifest.observation_dim)
        try_graph(graph, *sizes)
        prior_std = manifest.network.prior_std if manifest.network else None
        return OnnxPolicy(graph, *sizes, manifest.steps, batch, manifest.sampler, prior_std)


def load_bundle(directory: Path) -> Bundle:
    """Read and verify every file of a bundle.

    Raises:
        BundleError: names the file and key that is missing, damaged or does not fit.
    """
    if not os.path.isdir(directory):  # noqa: PTH112  # pathlib's raises for names that are too long
        raise BundleError(
            f"{directory}: no such bundle directory; edge-export writes one, --task takes a packaged one"
        )
    path = directory / MANIFEST_FILE
    encoded = _read(path, LARGEST_MANIFEST)
    if _read(directory / DIGEST_FILE, LARGEST_MANIFEST) != digest_line(encoded):
        raise BundleError(f"{path}: does not match its digest in {DIGEST_FILE}; copy the bundle again")
    manifest = read_manifest(encoded, path)
    check_manifest(manifest, str(path))
    contents = {name: _read_verified(directory / name, digest) for name, digest in manifest.files.items()}
    weights = None
    if manifest.runtime == "numpy":
        path = directory / WEIGHTS_FILE
        weights = unpack_weights(contents[WEIGHTS_FILE], manifest, str(path))
    return Bundle(manifest, weights, directory, hashlib.sha256(encoded).hexdigest())


def packaged_bundle(name: str) -> Bundle:
    """Load the bundle ``name`` that is installed with this package.

    Raises:
        BundleError: lists the packaged names if there is none of that name; else as `load_bundle`.
    """
    names = sorted(path.parent.name for path in PACKAGED.glob(f"*/{MANIFEST_FILE}"))
    if name not in names:
        known = ", ".join(names) or "none are installed"
        raise BundleError(f"{name!r} is not a packaged policy: {known}")
    return load_bundle(PACKAGED / name)


def digest_line(manifest: bytes) -> bytes:
    """The one line of ``manifest.sha256`` for an encoded manifest, as ``sha256sum`` writes it."""
    return f"{hashlib.sha256(manifest).hexdigest()}  {MANIFEST_FILE}\n".encode()


def _read(path: Path, largest: int) -> bytes:
    try:
        return read_regular(path, largest)
    except OSError as error:
        raise BundleError(f"{path}: cannot be read ({error.strerror}); export the bundle again") from error


def _read_verified(path: Path, digest: str) -> bytes:
    content = _read(path, LARGEST_FILE)
    if hashlib.sha256(content).hexdigest() != digest:
        raise BundleError(f"{path}: does not match its digest in {MANIFEST_FILE}; copy the bundle again")
    return content
