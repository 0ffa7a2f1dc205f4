"""Sources that tell of the robot itself: where it is, how it moves, what it was commanded."""

import math
from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.observation.source import Extent, Frame, Source, View, in_frame


class Position(Source, frozen=True, tag="position"):
    """Where the robot is."""

    unit_here: ClassVar[str] = "m"

    def components(self, extent: Extent) -> int:
        """One an axis."""
        return extent.dims

    def read(self, view: View) -> Vector:
        """In the team's frame."""
        return view.team.own.position_m


class Velocity(Source, frozen=True, kw_only=True, tag="velocity"):
    """How fast it moves."""

    unit_here: ClassVar[str] = "m/s"
    frame: Frame = "team"
    """Whose axes: the team's, or the robot's own."""

    def components(self, extent: Extent) -> int:
        """One an axis."""
        return extent.dims

    def read(self, view: View) -> Vector:
        """Along the axes of ``frame``."""
        return in_frame(view.team.own.velocity_m_s, self.frame, view)


class Heading(Source, frozen=True, tag="heading"):
    """Where its front points: sine and cosine of the angle from x, counter-clockwise."""

    unit_here: ClassVar[str] = "1"

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """Sine, then cosine."""
        return 2

    def read(self, view: View) -> Vector:
        """Of the heading."""
        heading_rad = view.team.own.heading_rad
        return math.sin(heading_rad), math.cos(heading_rad)


class YawRate(Source, frozen=True, tag="yaw_rate"):
    """How fast it turns, counter-clockwise."""

    unit_here: ClassVar[str] = "rad/s"

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """One."""
        return 1

    def read(self, view: View) -> Vector:
        """Of the robot."""
        return (view.team.own.yaw_rate_rad_s,)


class PreviousAction(Source, frozen=True, tag="previous_action"):
    """What it was commanded last, in the action's units; zero before the first command."""

    of_policy: ClassVar[bool] = True

    def components(self, extent: Extent) -> int:
        """Those of an action."""
        return extent.action_dim

    def read(self, view: View) -> Vector:
        """Within the limits, as it left the robot."""
        return view.previous_action or (0.0,) * self.size
