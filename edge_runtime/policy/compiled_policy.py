"""The velocity field in compiled C: `CompiledPolicy`, which also samples whole guided flows.

``_kernel.c`` is built with the package where a compiler is found; without it this module still imports,
and `CompiledPolicy` raises. `edge_runtime.policy.backend` chooses between it and numpy.
"""

import importlib
from array import array
from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Array
from edge_runtime.errors import PolicyError
from edge_runtime.messages import Vector
from edge_runtime.policy.flow_steps import SamplerName, Schedule, flow_steps
from edge_runtime.policy.velocity_field import (
    OwnSlope,
    Sample,
    Sampler,
    Sight,
    Steering,
    check_counts,
    check_observation,
)
from edge_runtime.policy.weights import FlowWeights

INTERFACE: Final = 7
"""Of the kernel that this module was written for; see ``_kernel.c``."""


class _Network(Protocol):
    """What is used of ``_kernel.Network``."""

    def observe(self, observation: Array) -> None: ...
    def step(self, k: int) -> None: ...
    def velocity(self, k: int) -> None: ...
    def sample(
        self,
        program: "array[float]",
        sight: Sight,
        view: "array[float]",
        start: Vector,
        left_s: float,
        most_steps: int,
        own: OwnSlope,
    ) -> tuple[Vector, int, int, int, int, Vector, tuple[int, ...], Vector, bool]: ...
    def sample_batch(self, program: "array[float]", sight: Sight, views: Array, actions: Array) -> None: ...


class _Kernel(Protocol):
    """What is used of the extension module."""

    TERMS: tuple[str, ...]
    """Kinds of terms, each at its number."""
    PROJECTIONS: tuple[str, ...]
    """Each at its number."""
    MAX_TERMS: int
    MAX_ACTION: int
    """Components of the longest action that it samples."""
    MAX_LAYERS: int

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
        PolicyError: if it was not built, does not load, or was built from other sources.
    """
    try:
        kernel: _Kernel = importlib.import_module("edge_runtime.policy._kernel")
    except ImportError as error:
        raise PolicyError(
            f"the compiled kernel is not usable ({error}); install a C compiler and reinstall cfpg-edge, "
            "or choose the numpy backend"
        ) from error
    if getattr(kernel, "INTERFACE", None) != INTERFACE:
        raise PolicyError("the compiled kernel is of another version; reinstall cfpg-edge")
    return kernel


def compiled_engines() -> list[str]:
    """The instruction sets of the kernel on this machine, the fastest first; none where it is not usable."""
    try:
        return load_kernel().engines()
    except PolicyError:
        return []


class CompiledPolicy:
    """v_theta(a, tau | o) and dv/da for B inputs at once; the `VelocityField` of ``_kernel.c``.

    Args:
        weights: the network.
        steps: T, the number of flow steps that ``step`` is prepared for.
        batch: B.
        sampler: how the flow is integrated in them.
        engine: one of the instruction sets that ``engines()`` lists; the fastest where empty.

    Raises:
        PolicyError: if ``steps`` or ``batch`` is below one, or the kernel is missing or cannot hold
            the network.
    """

    backend = "compiled"

    def __init__(
        self,
        weights: FlowWeights,
        steps: int,
        batch: int = 1,
        sampler: SamplerName = "euler",
        engine: str = "",
    ) -> None:
        check_counts(steps, batch)
        self.batch, self.schedule = batch, flow_steps(sampler, steps, weights.prior_std)
        self.action_dim, self.observation_dim = weights.action_dim, weights.observation_dim
        kernel = load_kernel()
        self.engine = engine or kernel.engines()[0]
        """The instruction set in use."""
        self._kinds = {name: number for number, name in enumerate(kernel.TERMS)}
        self._projections = {name: number for number, name in enumerate(kernel.PROJECTIONS)}
        self._most_terms, self._longest_action = kernel.MAX_TERMS, kernel.MAX_ACTION
        self._steering: Steering | None = None
        self._program: array[float] | None = None
        self._action = np.empty((batch, self.action_dim), np.float32)
        result = np.empty((batch, 1 + self.action_dim, self.action_dim), np.float32)
        self._velocity_and_tangents = result.transpose(1, 0, 2)
        self._velocity = result.ravel()[: self._action.size].reshape(self._action.shape)
        self._network = _build(kernel, weights, self.schedule, self._action, result, self.engine)

    def observe(self, observation: npt.ArrayLike) -> None:
        """Set the observations (B, O) for the coming steps.

        Raises:
            PolicyError: if the shape is not (B, O).
        """
        observation = np.ascontiguousarray(observation, np.float32)
        check_observation(observation, self.batch, self.observation_dim)
        self._network.observe(observation)

    def step(self, k: int, action: npt.ArrayLike) -> Array:
        """Velocity and Jacobian at the beginning of a step; see `VelocityField.step`."""
        self._action[:] = action
        self._network.step(k)
        return self._velocity_and_tangents

    def velocity(self, k: int, action: npt.ArrayLike) -> Array:
        """The velocity alone; see `VelocityField.velocity`."""
        self._action[:] = action
        self._network.velocity(k)
        return self._velocity

    @property
    def sampler(self) -> Sampler | None:
        """Itself."""
        return self

    def knows(self, steering: Steering) -> bool:
        """Whether the kernel can guide so; see `Sampler.knows`."""
        if steering is not self._steering:  # the same in every tick, until others are followed
            self._steering, self._program = steering, self._programmed(steering)
        return self._program is not None

    def _programmed(self, steering: Steering) -> "array[float] | None":
        """The steering as the kernel reads it, or None where it cannot; see ``_kernel_outlook.h``."""
        terms = steering.terms
        known = steering.projection in self._projections and len(terms) <= self._most_terms
        if not (
            known and self.action_dim <= self._longest_action and {t.kind for t in terms} <= {*self._kinds}
        ):
            return None
        head = (self._projections[steering.projection], steering.steers, len(terms), *steering[3:])
        program = array("d", head)
        for kind, *stated, motion, numbers in terms:
            program.extend((self._kinds[kind], *stated, len(motion), len(numbers), *motion, *numbers))
        return program

    def sample(
        self,
        steering: Steering,
        sight: Sight,
        view: Sequence[float],
        start: Vector,
        left_s: float,
        most_steps: int,
        own: OwnSlope,
    ) -> Sample:
        """Flow one robot's action through its steps; see `Sampler.sample`.

        Raises:
            PolicyError: if the policy is for several robots, or the steering, the view or the start is not
                one that the kernel knows.
        """
        if not self.knows(steering) or self._program is None:
            raise PolicyError("the compiled kernel cannot guide so")
        try:
            sampled = self._network.sample(
                self._program, sight, array("d", view), start, left_s, most_steps, own
            )
        except ValueError as error:
            raise PolicyError(f"the compiled kernel cannot sample: {error}") from error
        return Sample(*sampled)

    def sample_batch(self, steering: Steering, sight: Sight, views: Array, actions: Array) -> None:
        """Flow B robots' actions through all steps; see `Sampler.sample_batch`.

        Raises:
            PolicyError: if the steering, the views or the actions are not what the kernel knows.
        """
        if not self.knows(steering) or self._program is None:
            raise PolicyError("the compiled kernel cannot guide so")
        try:
            self._network.sample_batch(self._program, sight, views, actions)
        except ValueError as error:
            raise PolicyError(f"the compiled kernel cannot sample: {error}") from error


def _build(
    kernel: _Kernel, weights: FlowWeights, schedule: Schedule, action: Array, result: Array, engine: str
) -> _Network:
    """The network for the batch of ``action`` (B, d), which its steps read; ``result`` is what they write."""

    def contiguous(values: npt.ArrayLike) -> Array:
        return np.ascontiguousarray(values, np.float32)

    tau = np.array([step.tau for step in schedule])
    arrays = (
        contiguous(weights.action),
        contiguous(weights.observation),
        contiguous(weights.time_part(tau)),
        contiguous(weights.prior_gain(tau)),
        np.array(schedule),
        tuple(contiguous(matrix) for matrix in weights.matrices[:-1]),
        tuple(contiguous(bias) for bias in weights.biases[1:-1]),
        contiguous(weights.matrices[-1].T),
        contiguous(weights.biases[-1]),
    )
    sizes = (weights.action_dim, weights.observation_dim, len(schedule), len(action))
    try:
        silu = weights.activation == "silu"
        return kernel.Network(engine, silu, sizes, weights.hidden, arrays, action, result)
    except ValueError as error:
        raise PolicyError(f"the compiled kernel cannot hold this network: {error}") from error
