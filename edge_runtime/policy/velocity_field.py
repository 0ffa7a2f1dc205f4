"""What guidance needs of a policy, whoever computes it: a step's velocity and Jacobian, or a whole sample."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy.typing as npt

from edge_runtime.common.arrays import Array
from edge_runtime.errors import PolicyError
from edge_runtime.messages import Vector
from edge_runtime.policy.flow_steps import Schedule

PYTHON = "python"
"""The kind of a cost that is computed by who steers, see `OwnSlope`."""


class Term(NamedTuple):
    """One cost as it stands in every tick, in plain numbers; what it is for, a policy need not know."""

    kind: str
    """One that the sampler knows."""
    factor: float
    """What its gradient is multiplied by along the flow."""
    weight: float
    """What its gradient counts among those of other preferences."""
    preference: bool
    """Whether it moves a finished action by the view's reach at most."""
    horizon_s: float
    """How far ahead it looks."""
    motion: Vector
    """The robot's linear model so far ahead, see `edge_runtime.motion.linear.in_numbers`; else empty."""
    numbers: Vector
    """What a cost of its kind depends on besides."""


class Steering(NamedTuple):
    """How a flow is guided in every tick."""

    projection: str
    """How gradients that conflict are combined along the flow."""
    steers: bool
    """Whether they are combined along the flow at all."""
    terms: tuple[Term, ...]
    """M costs."""
    dims: int
    """2 where robots move in the plane, 3 in space."""
    rounds: int
    """In which preferences correct the finished action; below 0 it is left as it is, by preferences and
    requirements alike."""
    rate: float
    """The share of a Newton step that each of these rounds takes."""
    steps: int
    """In which requirements correct it after them at most."""


class Sight(NamedTuple):
    """How many things a robot sees."""

    mates: int
    obstacles: int
    tracked: int


OwnSlope = Callable[[int, Vector], tuple[float, Vector] | None]
"""The cost and gradient (d,) of the term at a place, at an action (d,); None where it has none."""


class Sample(NamedTuple):
    """A whole guided flow; compare `edge_runtime.messages.GuidedAction`."""

    action: Vector
    """Where the flow ended, corrected; or where it was when a gradient was not finite."""
    steps: int
    projections: int
    fault: int
    """Place of the term whose cost or gradient was not finite, or -1."""
    opposed: int
    costs: tuple[float, ...]
    conflicts: tuple[int, ...]
    correction: Vector
    cut: bool


class Sampler(Protocol):
    """Takes all steps of a flow at once."""

    def knows(self, steering: Steering) -> bool:
        """Whether it can guide so."""
        ...

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
        """Flow one robot's action through its steps, for the observation set before.

        Args:
            steering: how to guide; one that the sampler knows.
            sight: how many things the robot sees.
            view: what it sees: its number, position and velocity; x and y of each obstacle; of each tracked
                object 1, or 0 if it is not there, position and velocity; of each teammate its number,
                position, velocity and action; and how far preferences may move the finished action.
            start: the flow's start (d,).
            left_s: seconds from now by which the action is needed; may be infinite.
            most_steps: cut short after so many steps; T for all of them.
            own: computes terms of kind `PYTHON`.
        """
        ...

    def sample_batch(self, steering: Steering, sight: Sight, views: Array, actions: Array) -> None:
        """Flow B robots' actions through all steps.

        Args:
            steering: how to guide; without terms of kind `PYTHON`.
            sight: how many things each robot sees.
            views: (B, V) in float64: what each of them sees.
            actions: (B, d) in float64: the flow's start, and then where it ended; NaN where a gradient was
                not finite.
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
