"""Checks of the policy: whole files, and the same numbers from everything that can compute it."""

import importlib.util
from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, examine, fail, ok, warn
from edge_runtime.errors import PolicyError
from edge_runtime.policy.agreement import TOLERANCE, largest_difference
from edge_runtime.policy.backend import Backend
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.compiled_policy import CompiledPolicy

SAMPLES: Final = 64


def examine_policy(mission: Mission) -> Iterator[Finding]:
    """Check the bundle of a mission; its digests were verified when it was loaded."""
    yield examine("bundle", partial(bundle, mission.bundle))
    yield examine("parity", partial(parity, mission.bundle))
    yield examine("backend", partial(backend, mission.bundle, mission.backend))


def bundle(loaded: Bundle) -> Finding:
    """Name the bundle whose files all matched."""
    manifest = loaded.manifest
    return ok(
        f"{manifest.name} in {loaded.directory}: manifest and {len(manifest.files)} files match their "
        "SHA-256 digests"
    )


def parity(loaded: Bundle) -> Finding:
    """Whether numpy computes here what the bundle's graph says.

    Raises:
        PolicyError: if onnxruntime is needed and missing, or cannot compute the graph.
    """
    if loaded.weights is None:
        loaded.policy()
        return ok("onnxruntime alone computes this policy, there is nothing to compare")
    if importlib.util.find_spec("onnxruntime") is None:
        return warn("numpy was not compared with the graph", "run: pip install 'cfpg-edge[onnx]'")
    difference = _difference(loaded)
    detail = f"numpy and onnxruntime differ by {difference:.1e} on {SAMPLES} random inputs"
    return (
        ok(detail) if difference <= TOLERANCE else fail(detail, "reinstall numpy, or export the bundle again")
    )


def _difference(loaded: Bundle) -> float:
    manifest, random = loaded.manifest, np.random.default_rng(0)
    action = random.standard_normal((SAMPLES, manifest.action_dim)).astype(np.float32)
    tau = random.random(SAMPLES).astype(np.float32)
    observation = random.standard_normal((SAMPLES, manifest.observation_dim)).astype(np.float32)
    expected = loaded.graph_policy(SAMPLES).evaluate(action, tau, observation)
    found = loaded.policy(SAMPLES).evaluate(action, tau, observation)
    return largest_difference(found, expected)


def backend(loaded: Bundle, wanted: Backend) -> Finding:
    """Whether the compiled kernel works here and agrees with numpy: it is compared whenever it is loaded.

    Raises:
        PolicyError: if the backend that was asked for cannot run the policy.
    """
    if loaded.weights is None or wanted == "numpy":
        return ok(f"{loaded.field(wanted).backend}, as asked for")
    try:
        compiled = loaded.field("compiled")
    except PolicyError as error:
        if wanted == "compiled":
            raise
        return warn(f"{error}: numpy takes over and is slower", "reinstall cfpg-edge with a C compiler")
    engine = f" ({compiled.engine})" if isinstance(compiled, CompiledPolicy) else ""
    return ok(f"the compiled kernel{engine} agrees with numpy")
