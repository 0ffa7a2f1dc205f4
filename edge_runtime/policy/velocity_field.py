"""What guidance needs of a policy, whoever computes it: a step's velocity and Jacobian, or a whole sample."""

from collections.abc import Collection, Sequence
from typing import NamedTuple, Protocol

import numpy.typing as npt

from edge_runtime.common.arrays import Array
from edge_runtime.errors import PolicyError
from edge_runtime.messages import Vector
from edge_runtime.policy.flow_steps import Schedule

Term = tuple[str, Sequence[float], Sequence[float]]
"""One cost of one tick, in plain numbers; who states it and what it is for, a policy need not know.

Its kind, one that the sampler knows; its head, the same in every tick: the weight of its gradient, the
components, 2 or 3, of the position or velocity that it is of, and what the action adds to that, see
`edge_runtime.motion.linear.constant_gains`; and all else that a cost of this kind depends on.
"""


class Sample(NamedTuple):
    """A whole guided flow; compare `edge_runtime.messages.GuidedAction`."""

    action: Vector
    """Where the flow ended, or where it was when a gradient was not finite."""
    steps: int
    projections: int
    fault: int
    """Place of the term whose gradient was not finite, or -1."""
    opposed: int
    costs: tuple[float, ...]
    conflicts: tuple[int, ...]


class Sampler(Protocol):
    """Takes all steps of a flow at once."""

    def knows(self, projection: str, kinds: Collection[str]) -> bool:
        """Whether it can combine the gradients of so many costs of these kinds in this way."""
        ...

    def sample(
        self, projection: str, terms: Sequence[Term], start: Vector, left_s: float, most_steps: int
    ) -> Sample:
        """Flow one robot's action through its steps, for the observation set before.

        Args:
            projection: how gradients that conflict are combined.
            terms: M costs.
            start: the flow's start (d,).
            left_s: seconds from now by which the action is needed; may be infinite.
            most_steps: cut short after so many steps; T for all of them.
        """
        ...


def check_counts(steps: int, batch: int) -> None:
    """Refuse no steps, or no inputs.

    Raises:
        PolicyError: if either is below one.
    """
    if min(steps, batch) < 1:
        raise PolicyError(f"steps and batch must be at least 1, got {steps} and {batch}")


def check_observation(observation: Array, batch: int, size: int) -> None:
    """Refuse observations of another shape than (B, O).

    Raises:
        PolicyError: names both shapes.
    """
    if observation.shape != (batch, size):
        raise PolicyError(f"observation has shape {observation.shape}, this policy takes ({batch}, {size})")


class VelocityField(Protocol):
    """v_theta(a, tau | o) and dv/da, prepared for T steps and B inputs at once."""

    backend: str
    batch: int
    schedule: Schedule
    """The T steps."""
    action_dim: int
    observation_dim: int

    @property
    def sampler(self) -> Sampler | None:
        """Takes all steps at once; None where they are taken one by one."""
        ...

    def observe(self, observation: npt.ArrayLike) -> None:
        """Set the observations (B, O) for the coming steps."""
        ...

    def step(self, k: int, action: npt.ArrayLike) -> Array:
        """Evaluate at the beginning of a step.

        Args:
            k: its number, 0 <= k < T.
            action: (B, d) current actions along the flow.

        Returns:
            (1 + d, B, d), valid until the next call: [0] is the velocity v, [1 + j] is dv/da_j.
        """
        ...

    def velocity(self, k: int, action: npt.ArrayLike) -> Array:
        """Evaluate as ``step``, the velocity (B, d) alone, which costs less."""
        ...
