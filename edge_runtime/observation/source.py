"""The base of observation sources: where one field of the policy's input comes from."""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal, NamedTuple

import msgspec

from edge_runtime.errors import PolicyError
from edge_runtime.messages import TeamState, Vector
from edge_runtime.motion.range_sensor import RangeSensor

Frame = Literal["team", "body"]
"""Axes of a vector: the team's, or the robot's own, x forward and y to its left; both have z upward."""
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
"""Of something else that a field tells of."""
LARGEST_FIELD: Final = 4096
"""Components."""


class SourceError(PolicyError):
    """A source has nothing to give in this tick."""


class Extent(NamedTuple):
    """What the sizes of fields depend on."""

    dims: int
    """Of the robot's world: 2 in the plane, 3 in space."""
    action_dim: int
    rays: int
    """Of the robot's range sensor."""


class View(msgspec.Struct, frozen=True, gc=False):
    """What sources see in one tick: SI units, the team's frame."""

    team: TeamState
    goal_m: Vector
    sensor: RangeSensor
    previous_action: Vector = ()
    """What was commanded last."""
    elapsed_s: float = 0.0
    """Since the robot's first tick."""
    ease_m: float = 0.0
    """How much farther away than they are teammates are seen."""

    def ranges(self) -> Sequence[float]:
        """What the range sensor reads; readings that are computed from teammates are eased.

        Raises:
            PolicyError: if the number of readings is not the number of rays.
        """
        readings, reach = self.sensor.read(self.team), self.sensor.range_m
        if not self.ease_m or self.team.ranges_m is not None:
            return readings
        return [min(reading + self.ease_m, reach) for reading in readings]


class Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, tag_field="source"):
    """One contiguous piece of the observation vector, and where it comes from."""

    unit_here: ClassVar[str] = ""
    """What ``unit`` must be; the manifest alone decides where empty."""
    of_policy: ClassVar[bool] = False
    """Whether it is in the policy's metres, not in the robot's."""
    name: str
    """What reports call the field."""
    size: int
    """Components."""
    unit: str
    """Of each component."""
    seen: tuple[tuple[float, float], ...] | None = None
    """Least and greatest value of each component in training; None where that is not known."""

    @property
    def kind(self) -> str:
        """The ``source`` under which files know it."""
        return str(self.__struct_config__.tag)

    def components(self, extent: Extent) -> int | None:  # noqa: ARG002  # most depend on nothing
        """How many components it has; None where the manifest alone decides."""
        return None

    def read(self, view: View) -> Sequence[float]:
        """Its components in this tick; as many as ``size`` says.

        Raises:
            SourceError: if there is nothing to give: the robot stops.
        """
        raise NotImplementedError(f"{type(self).__name__} must define read(view)")


def apart(one: Vector, other: Vector) -> Vector:
    """``one`` minus ``other``.

    Raises:
        SourceError: if one lies in the plane and the other in space.
    """
    if len(one) != len(other):
        raise SourceError(f"it has {len(one)} components, and what it is compared with {len(other)}")
    return tuple(a - b for a, b in zip(one, other, strict=True))


def in_frame(vector: Vector, frame: Frame, view: View) -> Vector:
    """Components of a vector of the team's frame along the axes asked for."""
    if frame == "team":
        return vector
    heading_rad = view.team.own.heading_rad
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    x, y, *up = vector
    return (cosine * x + sine * y, cosine * y - sine * x, *up)
