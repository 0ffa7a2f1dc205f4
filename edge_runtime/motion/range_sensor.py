"""A robot's range sensor: what it reads of discs, and what in its readings is no teammate.

Rays lie in the plane, point along fixed directions of the team's frame and start at the robot's centre.
Readings of discs are those of VMAS 1.5.2: a disc counts only if its centre lies ahead; the reading is
the first crossing with its rim, below zero where the ray starts inside the disc, and never above the
sensor's range.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import msgspec

from edge_runtime.errors import PolicyError
from edge_runtime.messages import Teammate, TeamState, Vector, Vector2

EXPLAINED_M: Final = 0.05
"""A reading that ends so near a teammate's disc is the teammate's: poses and readings have errors."""
APART: Final = math.cos(math.radians(45.0))
"""Of two points that lie in directions nearer than this the farther one is left out. An obstacle then counts
about once, however many rays it takes, and at most eight points surround a robot."""

Disc = tuple[float, float, float]
"""Centre and radius in m."""


class RangeSensor(msgspec.Struct, frozen=True, gc=False):
    """The rays of one robot; any number of them.

    Raises:
        PolicyError: from its methods, if the number of readings is not the number of rays.
    """

    rays: tuple[Vector2, ...]
    """Unit vectors."""
    range_m: float
    """A reading of this much saw nothing."""
    radius_m: float
    """Of the robots' discs."""

    def read(self, team: TeamState) -> Sequence[float]:
        """Return what the team's view holds of real readings, in m; else those of the teammates' discs."""
        if team.ranges_m is None:
            mates = (mate.state.position_m for mate in team.teammates + team.silent)
            return self.readings(team.own.position_m, self.discs(team.own.position_m, mates))
        if len(team.ranges_m) != len(self.rays):
            raise PolicyError(
                f"got {len(team.ranges_m)} ranges, the policy's sensor has {len(self.rays)} rays"
            )
        return team.ranges_m

    def discs(self, origin: Vector, places: Iterable[Vector]) -> Iterator[Disc]:
        """Yield robots' discs; in space, what a plane at the origin's height cuts of their balls."""
        for x, y, *height in places:
            radius = self.radius_m
            if height:
                radius = math.sqrt(max(0.0, radius * radius - (height[0] - origin[2]) ** 2))
            yield x, y, radius

    def readings(self, origin: Vector, discs: Iterable[Disc]) -> list[float]:
        """Compute readings in m, from the robot's centre: see the module's text."""
        ranges = [self.range_m] * len(self.rays)
        for disc_x, disc_y, radius in discs:
            x, y = disc_x - origin[0], disc_y - origin[1]
            square, visible = radius * radius, self.range_m + radius
            if x * x + y * y >= visible * visible:
                continue
            for ray, (ray_x, ray_y) in enumerate(self.rays):
                ahead, aside = x * ray_x + y * ray_y, x * ray_y - y * ray_x
                if ahead > 0.0 and aside * aside < square:
                    ranges[ray] = min(ranges[ray], ahead - math.sqrt(square - aside * aside))
        return ranges

    def obstacles(self, team: TeamState) -> tuple[Vector2, ...]:
        """Return the points, nearest first, at which rays ended on something that is no teammate.

        Empty where there are no real readings: computed ones are all of teammates. A teammate explains what
        lies within its disc and as far around as it may have moved since it was heard. Of the others the
        nearest count, see `APART`.
        """
        if team.ranges_m is None:
            return ()
        x, y, *_ = team.own.position_m
        mates = team.teammates + team.silent
        kept: list[Vector2] = []
        points: list[Vector2] = []
        for reading, (ray_x, ray_y) in sorted(zip(self.read(team), self.rays, strict=True)):
            if reading >= self.range_m:
                break
            point = (x + max(reading, 0.0) * ray_x, y + max(reading, 0.0) * ray_y)
            hidden = any(ray_x * other_x + ray_y * other_y > APART for other_x, other_y in kept)
            if hidden or any(self._explains(mate, point) for mate in mates):
                continue
            kept.append((ray_x, ray_y))
            points.append(point)
        return tuple(points)

    def _explains(self, mate: Teammate, point: Vector2) -> bool:
        moved = math.hypot(*mate.state.velocity_m_s) * mate.age_s
        return math.dist(point, mate.state.position_m[:2]) <= self.radius_m + EXPLAINED_M + moved
