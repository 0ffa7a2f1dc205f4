"""Sources that tell of the task: the robot's goal, the time that is left, and constants."""

from typing import Annotated, ClassVar

import msgspec

from edge_runtime.common.bounds import GREATEST
from edge_runtime.messages import Vector
from edge_runtime.observation.source import (
    LARGEST_FIELD,
    Extent,
    Frame,
    Source,
    View,
    apart,
    in_frame,
)

Value = Annotated[float, msgspec.Meta(ge=-GREATEST, le=GREATEST)]


class GoalOffset(Source, frozen=True, kw_only=True, tag="goal_offset"):
    """The robot's position minus its goal."""

    unit_here: ClassVar[str] = "m"
    frame: Frame = "team"
    """Whose axes: the team's, or the robot's own."""

    def components(self, extent: Extent) -> int:
        """One an axis."""
        return extent.dims

    def read(self, view: View) -> Vector:
        """Along the axes of ``frame``."""
        return in_frame(apart(view.team.own.position_m, view.goal_m), self.frame, view)


class TimeLeft(Source, frozen=True, kw_only=True, tag="time_left"):
    """Time to the horizon, which began with the robot's first tick; zero after it."""

    unit_here: ClassVar[str] = "s"
    horizon_s: Annotated[float, msgspec.Meta(gt=0, le=GREATEST)]
    """After which nothing is left."""

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """One."""
        return 1

    def read(self, view: View) -> Vector:
        """In this tick."""
        return (max(0.0, self.horizon_s - view.elapsed_s),)


class Constant(Source, frozen=True, kw_only=True, tag="constant"):
    """The same numbers in every tick, such as a preference."""

    of_policy: ClassVar[bool] = True

    values: Annotated[tuple[Value, ...], msgspec.Meta(min_length=1, max_length=LARGEST_FIELD)]
    """The components."""

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """As many as there are values."""
        return len(self.values)

    def read(self, view: View) -> Vector:  # noqa: ARG002
        """As the manifest states them."""
        return self.values
