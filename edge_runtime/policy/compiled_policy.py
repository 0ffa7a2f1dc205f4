"""The velocity field in compiled C: `CompiledPolicy`, and the guided flow with the built-in objectives.

``_kernel.c`` is built with the package where a compiler is found; without it this module still imports,
and `CompiledPolicy` raises. `edge_runtime.policy.backend` chooses between it and numpy.
"""

import importlib
import math
from array import array
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Array
from edge_runtime.errors import PolicyError
from edge_runtime.guidance.projection import Projection
from edge_runtime.messages import Vector2
from edge_runtime.motion.outlook import Outlook
from edge_runtime.objectives import Objective, SafetyMargin, SpeedLimit
from edge_runtime.policy.weights import FlowWeights

PROJECTIONS: Final[tuple[Projection, ...]] = ("none", "hierarchical", "cone")
"""In the order of the enumeration in ``_kernel_guidance.h``."""
MAX_TERMS: Final = 32


class Sample(NamedTuple):
    """What the compiled flow returns; compare `edge_runtime.guidance.flow.GuidedAction`."""

    action: Vector2
    steps: int
    projections: int
    fault: int
    """Index of the objective whose gradient was not finite, or -1."""
    opposed: int
    costs: tuple[float, ...]
    conflicts: tuple[int, ...]


class _Network(Protocol):
    """What is used of ``_kernel.Network``."""

    def observe(self, observation: Array) -> None: ...
    def step(self, k: int) -> None: ...
    def sample(
        self,
        projection: int,
        count: int,
        terms: "array[float]",
        start: Vector2,
        left_s: float,
        most_steps: int,
    ) -> tuple[Vector2, int, int, int, int, tuple[float, ...], tuple[int, ...]]: ...


class _Kernel(Protocol):
    """What is used of the extension module."""

    def engines(self) -> list[str]: ...
    def Network(  # noqa: N802
        self,
        engine: str,
        silu: bool,
        sizes: tuple[int, ...],
        widths: tuple[int, ...],
        arrays: tuple[object, ...],
        action: Array,
        result: Array,
    ) -> _Network: ...


def load_kernel() -> _Kernel:
    """Import the compiled module.

    Raises:
        PolicyError: if it was not built or does not load.
    """
    try:
        kernel: _Kernel = importlib.import_module("edge_runtime.policy._kernel")
    except ImportError as error:
        raise PolicyError(
            f"the compiled kernel is not usable ({error}); install a C compiler and reinstall cfpg-edge, "
            "or choose the numpy backend"
        ) from error
    return kernel


class CompiledPolicy:
    """v_theta(a, tau | o) and dv/da for B inputs at once; the `VelocityField` of ``_kernel.c``.

    Args:
        weights: the network.
        euler_steps: T, the number of flow steps that ``step`` is prepared for.
        batch: B.
        engine: one of the instruction sets that ``engines()`` lists; the fastest where empty.

    Raises:
        PolicyError: if ``euler_steps`` or ``batch`` is below one, or the kernel is missing or cannot hold
            the network.
    """

    backend = "compiled"

    def __init__(self, weights: FlowWeights, euler_steps: int, batch: int = 1, engine: str = "") -> None:
        if euler_steps < 1 or batch < 1:
            raise PolicyError(f"euler_steps and batch must be at least 1, got {euler_steps} and {batch}")
        self.batch, self.euler_steps = batch, euler_steps
        self.action_dim, self.observation_dim = weights.action_dim, weights.observation_dim
        kernel = load_kernel()
        self.engine = engine or kernel.engines()[0]
        """The instruction set in use."""
        self._action = np.empty((batch, self.action_dim), np.float32)
        result = np.empty((batch, 1 + self.action_dim, self.action_dim), np.float32)
        self._velocity_and_tangents = result.transpose(1, 0, 2)
        self._network = _build(kernel, weights, euler_steps, self._action, result, self.engine)

    def observe(self, observation: npt.ArrayLike) -> None:
        """Set the observations (B, O) for the coming steps.

        Raises:
            PolicyError: if the shape is not (B, O).
        """
        observation = np.ascontiguousarray(observation, np.float32)
        if observation.shape != (self.batch, self.observation_dim):
            raise PolicyError(
                f"observation has shape {observation.shape}, this policy takes "
                f"({self.batch}, {self.observation_dim})"
            )
        self._network.observe(observation)

    def step(self, k: int, action: npt.ArrayLike) -> Array:
        """Velocity and Jacobian at flow time k / T; see `VelocityField.step`."""
        self._action[:] = action
        self._network.step(k)
        return self._velocity_and_tangents

    def sample(
        self,
        projection: Projection,
        terms: Sequence[Sequence[float]],
        start: Vector2,
        left_s: float,
        most_steps: int,
    ) -> Sample:
        """Flow one planar robot's action through its steps, for the observation set before.

        Args:
            projection: how conflicts are resolved.
            terms: M encoded objectives, see `encode`.
            start: the flow's start.
            left_s: seconds from now by which the action is needed; may be infinite.
            most_steps: cut short after so many steps; T for all of them.
        """
        numbers = array("d", [number for term in terms for number in term])
        return Sample(
            *self._network.sample(
                PROJECTIONS.index(projection), len(terms), numbers, start, left_s, most_steps
            )
        )


def encodable(objective: Objective) -> bool:
    """Whether the kernel computes this objective itself; anything else runs in Python."""
    return type(objective) in (SpeedLimit, SafetyMargin)


def encode(objective: Objective, outlook: Outlook, factor: float) -> list[float]:
    """One objective in one tick as ``Term`` in ``_kernel_guidance.h`` reads it."""
    preview, drift = outlook.preview, outlook.drift
    gains = [factor, preview.position_gain, preview.velocity_gain]
    if isinstance(objective, SpeedLimit):
        return [0.0, *gains, objective.limit_m_s - objective.buffer_m_s, drift.vx, drift.vy, 0.0]
    if not isinstance(objective, SafetyMargin):
        raise TypeError(f"the kernel does not know {type(objective).__name__}")
    numbers: list[float] = [
        1.0,
        *gains,
        objective.distance_m + objective.buffer_m,
        drift.x,
        drift.y,
        len(outlook.neighbours),
    ]
    for mate in outlook.neighbours:
        numbers += (mate.x, mate.y, math.copysign(1.0, outlook.robot_id - mate.robot_id))
    return numbers


def _build(
    kernel: _Kernel, weights: FlowWeights, euler_steps: int, action: Array, result: Array, engine: str
) -> _Network:
    """The network for the batch of ``action`` (B, d), which its steps read; ``result`` is what they write."""

    def contiguous(values: npt.ArrayLike) -> Array:
        return np.ascontiguousarray(values, np.float32)

    tau = np.arange(euler_steps) / euler_steps
    arrays = (
        contiguous(weights.action),
        contiguous(weights.observation),
        contiguous(weights.time_part(tau)),
        contiguous(weights.prior_gain(tau)),
        tuple(contiguous(matrix) for matrix in weights.matrices[:-1]),
        tuple(contiguous(bias) for bias in weights.biases[1:-1]),
        contiguous(weights.matrices[-1].T),
        contiguous(weights.biases[-1]),
    )
    sizes = (weights.action_dim, weights.observation_dim, euler_steps, len(action))
    try:
        silu = weights.activation == "silu"
        return kernel.Network(engine, silu, sizes, weights.hidden, arrays, action, result)
    except ValueError as error:
        raise PolicyError(f"the compiled kernel cannot hold this network: {error}") from error
