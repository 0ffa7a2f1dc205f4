"""The base of execution objectives: costs of a robot's predicted motion, with analytic gradients.

An objective states its cost J and its derivatives over the motion that it predicts ``look_ahead`` control
steps ahead; the chain rule through the motion model and the flow is the runtime's (eq. 11). The
built-in costs are half the squared action that would cure the violation, so that one guidance scale means
the same to all of them.
"""

import math
from typing import ClassVar, Literal, NamedTuple

import msgspec

from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.common.units import unit_of
from edge_runtime.messages import Vector
from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Outlook
from edge_runtime.motion.prediction import PredictedMotion

Quantity = Literal["", "position", "velocity"]
LONGEST_LOOK_AHEAD = 1000
"""Steps; a constant action has long lost its meaning there."""


class Slope(NamedTuple):
    """A cost and its derivatives with respect to the robot's own predicted motion.

    Those that the robot's motion model does not have count for nothing.
    """

    cost: float
    d_x: float = 0.0
    d_y: float = 0.0
    d_vx: float = 0.0
    d_vy: float = 0.0
    d_z: float = 0.0
    d_vz: float = 0.0
    d_heading: float = 0.0
    d_yaw_rate: float = 0.0


class Objective(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="type"):
    """Base of every execution objective.

    Raises:
        ValueError: if a number is not finite or absurdly large, the weight is negative, or ``look_ahead``
            is out of range.
    """

    preference: ClassVar[bool] = False
    """Whether this is a wish and no requirement: it moves actions by `GuidanceSettings.reach` at most, and
    yields to what is required."""
    sees_team: ClassVar[bool] = True
    """Whether it looks at `Outlook.neighbours`, which are left out otherwise. It counts only where the class
    itself states it: a subclass has a cost of its own."""
    of: ClassVar[Quantity] = ""
    """Of what its cost is, divided by the motion model's gain of it; empty for another cost."""
    weight: float = 1.0
    """lambda_m, the preference weight (eq. 4)."""
    look_ahead: int = 1
    """How many control steps ahead the motion is predicted."""

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"`{field}` must be finite, got {value}")
            if isinstance(value, float | tuple):
                check_bounds(self, {field: (-GREATEST, GREATEST)})
        self.require_not_negative("weight")
        if not 1 <= self.look_ahead <= LONGEST_LOOK_AHEAD:
            raise ValueError(f"`look_ahead` must lie in [1, {LONGEST_LOOK_AHEAD}], got {self.look_ahead}")

    def require_positive(self, *fields: str) -> None:
        """Raise ValueError for the first of these fields that is not above zero."""
        for field in fields:
            if getattr(self, field) <= 0.0:
                raise ValueError(f"`{field}` must be positive, got {getattr(self, field)}")

    def require_not_negative(self, *fields: str) -> None:
        """Raise ValueError for the first of these fields that is below zero."""
        for field in fields:
            if getattr(self, field) < 0.0:
                raise ValueError(f"`{field}` must not be negative, got {getattr(self, field)}")

    @property
    def name(self) -> str:
        """The name under which configuration and reports know this objective."""
        return str(self.__struct_config__.tag or type(self).__name__)

    @property
    def asks(self) -> str:
        """What it asks for: its first own number, with the unit that its name ends in; empty without one."""
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if field not in Objective.__struct_fields__ and isinstance(value, int | float):
                return f"{value:g} {unit_of(field)}".strip()
        return ""

    @property
    def looks_at(self) -> tuple[str, ...]:
        """Names of the tracked objects that it needs to know of."""
        return ()

    @property
    def sight_m(self) -> float:
        """How far from its centre the robot must see obstacles; 0 for one that does not look at them."""
        return 0.0

    def refuses(self, model: Model) -> str:
        """Why this cannot be asked of a robot that moves so; empty where it can."""
        preview = model.preview(self.look_ahead)
        gains = {"": 1.0, "position": preview.position_gain, "velocity": preview.velocity_gain}
        return "" if gains[self.of] else f"no action changes its {self.of} within look_ahead"

    def evaluate(self, motion: PredictedMotion, outlook: Outlook) -> Slope:
        """Cost and slope at one robot's predicted motion."""
        raise NotImplementedError(f"{type(self).__name__} must define evaluate(motion, outlook)")

    def kernel_numbers(self) -> Vector:
        """Numbers of which the compiled kernel computes this very cost; ``_kernel_outlook.h`` says which.

        It knows the objectives of this package by their names; all others are computed in Python.
        """
        raise NotImplementedError(f"{type(self).__name__} is computed in Python")
