"""The base of motion models: what an action does to a robot in one control step, and in several."""

import functools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

import msgspec

from edge_runtime.common.bounds import GREATEST
from edge_runtime.messages import RobotState
from edge_runtime.motion.linear import Axis, preview_of
from edge_runtime.motion.prediction import Columns, PredictedMotion, Preview

Self = TypeVar("Self", bound="Model")
Fault = tuple[str, object, str]
"""A key of a model, the value found there, and what would fit."""


class Model(msgspec.Struct, frozen=True, gc=False, forbid_unknown_fields=True, tag_field="type"):
    """How a robot moves under its policy's action, step by step of ``dt_s``.

    One step of a plant is one step of the prediction: the equations are written nowhere else.
    """

    if TYPE_CHECKING:  # a field of each model, which would hide a property

        @property
        def dt_s(self) -> float:
            """The control period that the model was stated for, in s."""
            ...

    @property
    def kind(self) -> str:
        """The ``type`` under which files know the model."""
        return str(self.__struct_config__.tag)

    @property
    def dims(self) -> int:
        """2 in the plane, 3 in space."""
        raise NotImplementedError

    @property
    def turns(self) -> bool:
        """Whether heading and yaw rate are among what the action moves."""
        raise NotImplementedError

    @property
    def action_dim(self) -> int:
        """d, the action's components."""
        raise NotImplementedError

    def preview(self, steps: int) -> Preview:
        """Look ``steps`` control periods ahead under a constant action.

        Raises:
            ValueError: if ``steps`` is below one.
        """
        raise NotImplementedError

    def predict(self, state: RobotState, action: Sequence[float], steps: int = 1) -> PredictedMotion:
        """The motion after so many control periods under a constant action (d,).

        Raises:
            ValueError: if ``steps`` is below one, or the action has another number of components.
        """
        return preview(self, steps).predict(state, action)

    def jacobian(self, state: RobotState, action: Sequence[float], steps: int = 1) -> Columns:
        """How that motion depends on the action, at this one.

        Raises:
            ValueError: as `predict`.
        """
        return preview(self, steps).forecast(state).at(action)[1].columns

    def at_period(self: Self, period_s: float) -> Self:
        """The same robot integrated with another period."""
        raise NotImplementedError

    def scaled(self: Self, scale_m: float) -> Self:
        """The same motion in a world where one of these metres is ``scale_m``, under the same action."""
        raise NotImplementedError

    def faults(self) -> Iterator[Fault]:
        """What of the model's numbers does not hold together; nothing for a sound one."""
        raise NotImplementedError


@functools.lru_cache(maxsize=64)
def preview(model: Model, steps: int) -> Preview:
    """`Model.preview`, computed once for each model and number of steps."""
    return model.preview(steps)


def velocity_gains(model: Model, steps: int) -> list[float]:
    """How fast a unit of each action component alone makes a robot at rest, after so many steps, in m/s."""
    rest = (0.0,) * model.dims
    columns = model.jacobian(RobotState(0, 0.0, rest, rest), (0.0,) * model.action_dim, steps)
    return [math.hypot(vx, vy, *others[1:2]) for _, _, vx, vy, *others in columns]


class LinearModel(Model, frozen=True):
    """A model whose Jacobian is the same everywhere; it states the axes of one step."""

    @property
    def action_dim(self) -> int:
        """One component an axis, unless a model says otherwise."""
        return self.dims + self.turns

    def axes(self) -> tuple[Axis, ...]:
        """One step along x, y, in space z, and then, of a model that turns, of the heading."""
        raise NotImplementedError

    def preview(self, steps: int) -> Preview:
        """See `Model.preview`."""
        return preview_of([axis.after(steps) for axis in self.axes()], len(self.axes()) - self.turns)


def unit_rows(count: int) -> list[tuple[float, ...]]:
    """The rows of an identity matrix: each component acts on an axis of its own."""
    return [tuple(float(row == column) for column in range(count)) for row in range(count)]


def outside(key: str, value: float, low: float, high: float) -> Iterator[Fault]:
    """The fault of a number that does not lie in [low, high], or is none."""
    if not low <= value <= high:
        yield key, value, f"between {low:g} and {high:g}"


def not_positive(key: str, value: float) -> Iterator[Fault]:
    """The fault of a number that is zero, negative or absurd."""
    return outside(key, value, 1.0 / GREATEST, GREATEST)


def no_share(key: str, value: float) -> Iterator[Fault]:
    """The fault of a number that is not in [0, 1)."""
    if not 0.0 <= value < 1.0:
        yield key, value, "at least 0 and below 1"
