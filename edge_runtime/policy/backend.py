"""Which implementation computes a policy: chosen once at load, and named in every report."""

import functools
import sys
from collections.abc import Iterator
from typing import Final, Literal, get_args

import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.errors import PolicyError
from edge_runtime.policy.compiled_policy import CompiledPolicy
from edge_runtime.policy.flow_steps import SamplerName
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.weights import FlowWeights

Backend = Literal["auto", "numpy", "compiled"]
BACKENDS: Final[tuple[Backend, ...]] = get_args(Backend)

_TOLERANCE: Final = 1e-5
"""Largest difference between the backends, as a share of the largest number compared."""


def make_policy(
    weights: FlowWeights,
    steps: int,
    batch: int = 1,
    sampler: SamplerName = "euler",
    backend: Backend = "auto",
) -> FlowPolicy | CompiledPolicy:
    """Prepare a network for ``batch`` observations at once.

    Args:
        weights: the network.
        steps: T.
        batch: B.
        sampler: how the flow is integrated in them.
        backend: ``auto`` takes the compiled kernel where it works and numpy elsewhere, with one warning
            on stderr that says why.

    Raises:
        PolicyError: if a number is below one, the backend is unknown, the network computes what is not
            finite, or ``compiled`` was asked for and the kernel is missing, cannot hold the network or does
            not agree with numpy.
    """
    if backend not in BACKENDS:
        raise PolicyError(f"backend {backend!r} is not one of {', '.join(BACKENDS)}")
    reference = FlowPolicy(weights, steps, batch, sampler)
    _check_finite(reference)
    if backend == "numpy":
        return reference
    try:
        compiled = CompiledPolicy(weights, steps, batch, sampler)
        _check_agreement(compiled, reference)
    except PolicyError as error:
        if backend == "compiled":
            raise
        _warn(f"edge_runtime: {error}; continuing with the numpy backend")
        return reference
    return compiled


def _steps(policy: FlowPolicy | CompiledPolicy) -> Iterator[Array]:
    """What a policy computes from ordinary inputs at each flow time."""
    rng = np.random.default_rng(0)
    for k in range(len(policy.schedule)):
        policy.observe(rng.standard_normal((policy.batch, policy.observation_dim), np.float32))
        yield policy.step(k, rng.standard_normal((policy.batch, policy.action_dim), np.float32))


def _check_finite(policy: FlowPolicy) -> None:
    """Refuse weights that are finite each, and too large together."""
    with np.errstate(all="ignore"):
        if not all(np.isfinite(step).all() for step in _steps(policy)):
            raise PolicyError("the policy's network computes numbers that are not finite; train it again")


def _check_agreement(policy: CompiledPolicy, reference: FlowPolicy) -> None:
    for found, expected in zip(_steps(policy), _steps(reference), strict=True):
        difference, size = float(np.abs(found - expected).max()), float(np.abs(expected).max())
        if not difference <= _TOLERANCE * max(1.0, size):
            raise PolicyError(
                f"the compiled kernel ({policy.engine}) differs from numpy by {difference:.2g} on random "
                "inputs; reinstall cfpg-edge, or choose the numpy backend"
            )


@functools.cache
def _warn(message: str) -> None:
    """Say the same thing once a process."""
    print(message, file=sys.stderr)
