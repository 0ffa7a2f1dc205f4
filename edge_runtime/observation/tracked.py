"""Sources that tell of a tracked object: a payload, a person, a door, by its name in the fleet file."""

import math
from typing import Annotated, ClassVar, Literal

import msgspec

from edge_runtime.messages import TrackedObject, Vector
from edge_runtime.observation.source import Extent, Frame, Name, Source, SourceError, View, apart, in_frame


class Tracked(Source, frozen=True, kw_only=True):
    """Base of those that tell of one object."""

    object: Name
    """Its name."""

    def tracked(self, view: View) -> TrackedObject:
        """The object as it is in this tick.

        Raises:
            SourceError: if its pose is not known, or too old.
        """
        for found in view.team.tracked:
            if found.name == self.object:
                return found
        raise SourceError(f"the pose of tracked object {self.object!r} is not known")


class _TrackedVector(Tracked, frozen=True, kw_only=True):
    frame: Frame = "team"
    """Whose axes: the team's, or the robot's own."""

    def components(self, extent: Extent) -> int:
        """One an axis."""
        return extent.dims


class TrackedOffset(_TrackedVector, frozen=True, kw_only=True, tag="tracked_offset"):
    """The robot's position minus the object's."""

    unit_here: ClassVar[str] = "m"

    def read(self, view: View) -> Vector:
        """Along the axes of ``frame``."""
        return in_frame(apart(view.team.own.position_m, self.tracked(view).position_m), self.frame, view)


class TrackedGoalOffset(_TrackedVector, frozen=True, kw_only=True, tag="tracked_goal_offset"):
    """The object's position minus the goal that the fleet file has for it."""

    unit_here: ClassVar[str] = "m"

    def read(self, view: View) -> Vector:
        """Along the axes of ``frame``."""
        found = self.tracked(view)
        if found.goal_m is None:
            raise SourceError(f"tracked object {self.object!r} has no goal_m in the fleet file")
        return in_frame(apart(found.position_m, found.goal_m), self.frame, view)


class TrackedVelocity(_TrackedVector, frozen=True, kw_only=True, tag="tracked_velocity"):
    """The object's velocity."""

    unit_here: ClassVar[str] = "m/s"

    def read(self, view: View) -> Vector:
        """Along the axes of ``frame``."""
        return in_frame(self.tracked(view).velocity_m_s, self.frame, view)


class TrackedHeading(Tracked, frozen=True, kw_only=True, tag="tracked_heading"):
    """Sine and cosine of its heading times its symmetry: 2 for what looks alike after half a turn."""

    unit_here: ClassVar[str] = "1"
    symmetry: Annotated[int, msgspec.Meta(ge=1, le=100)] = 1
    """How often it looks the same in a turn: a line 2, a square 4."""
    only: Literal["sine", "cosine"] | None = None
    """The one of both that the policy observes."""

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """Sine, then cosine; or one of them."""
        return 1 if self.only else 2

    def read(self, view: View) -> Vector:
        """In the team's frame."""
        angle_rad = self.symmetry * self.tracked(view).heading_rad
        both = {"sine": math.sin(angle_rad), "cosine": math.cos(angle_rad)}
        return (both[self.only],) if self.only else tuple(both.values())


class TrackedYawRate(Tracked, frozen=True, kw_only=True, tag="tracked_yaw_rate"):
    """How fast the object turns, counter-clockwise."""

    unit_here: ClassVar[str] = "rad/s"

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """One."""
        return 1

    def read(self, view: View) -> Vector:
        """In the team's frame."""
        return (self.tracked(view).yaw_rate_rad_s,)
