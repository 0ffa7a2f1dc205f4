"""Sources that tell of the nearest teammates: nearest first, zero where there are fewer.

Masked ones count as they are known, at rest: they are in the way still.
"""

import math
from typing import Annotated, ClassVar

import msgspec

from edge_runtime.common.bounds import MOST_ROBOTS
from edge_runtime.messages import RobotState, Vector
from edge_runtime.observation.source import Extent, Frame, Source, View, apart, in_frame


class _Nearest(Source, frozen=True, kw_only=True):
    count: Annotated[int, msgspec.Meta(ge=1, le=MOST_ROBOTS)]
    """Of how many teammates."""

    def components(self, extent: Extent) -> int:
        """One an axis and teammate."""
        return self.count * extent.dims

    def nearest(self, view: View) -> list[RobotState]:
        """At most ``count`` teammates' states; of two that are equally near the lower id comes first."""
        own, team = view.team.own.position_m, view.team
        states = [mate.state for mate in team.teammates + team.silent]
        states.sort(key=lambda state: (math.dist(own, state.position_m), state.robot_id))
        return states[: self.count]

    def padded(self, values: list[float]) -> list[float]:
        """Zeros up to the field's size."""
        return values + [0.0] * (self.size - len(values))


class _Relative(_Nearest, frozen=True, kw_only=True):
    frame: Frame = "team"
    """Whose axes: the team's, or the robot's own."""

    def of(self, state: RobotState) -> Vector:
        """What is compared of two robots' states."""
        raise NotImplementedError

    def read(self, view: View) -> list[float]:
        """Along the axes of ``frame``."""
        own = self.of(view.team.own)
        differences = (apart(own, self.of(state)) for state in self.nearest(view))
        return self.padded([value for each in differences for value in in_frame(each, self.frame, view)])


class TeammateOffsets(_Relative, frozen=True, kw_only=True, tag="teammate_offsets"):
    """The robot's position minus each teammate's."""

    unit_here: ClassVar[str] = "m"

    def of(self, state: RobotState) -> Vector:
        """The position."""
        return state.position_m


class TeammateVelocities(_Relative, frozen=True, kw_only=True, tag="teammate_velocities"):
    """The robot's velocity minus each teammate's."""

    unit_here: ClassVar[str] = "m/s"

    def of(self, state: RobotState) -> Vector:
        """The velocity."""
        return state.velocity_m_s


class TeammatesPresent(_Nearest, frozen=True, kw_only=True, tag="teammates_present"):
    """One for each teammate that the fields above tell of, zero where they are filled up."""

    unit_here: ClassVar[str] = "1"

    def components(self, extent: Extent) -> int:  # noqa: ARG002
        """One a teammate."""
        return self.count

    def read(self, view: View) -> Vector:
        """Nearest first."""
        found = min(self.count, len(view.team.teammates) + len(view.team.silent))
        return (1.0,) * found + (0.0,) * (self.count - found)
