"""The teams that are measured, and the rows of ``team_size.json``."""

import math
from collections.abc import Iterator

import msgspec

from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import ARENA_HALF_WIDTH_M, ROBOTS

SIZES = (2, 3, 4, 6, 8, 16, 32)
HEARD = (3, 7)
NARROW = (1.5, 2.0, 3.0)
EASE_M = 0.1
MIXED_KG = (0.5, 1.0, 2.0)
"""Masses of a mixed team's robots, in turn; the policy and its guidance know robots of 1 kg."""


class Team(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a team differs from the training's."""

    robots: int
    crowding: float = 1.0
    """Robots per area, as a multiple of the training's."""
    neighbours: int | None = None
    """K, the nearest that guidance hears of; None for all."""
    mixed: bool = False
    """Whether robots weigh `MIXED_KG` in turn."""
    ease_m: float = 0.0
    """How much farther away than they are the policy sees teammates: see `GuidanceSettings.ease_m`."""
    familiar: bool = False
    """Whether robots observe places and goals only as far away as in training; see `measure.familiar`."""

    @property
    def half_width_m(self) -> float:
        """Of the arena."""
        return ARENA_HALF_WIDTH_M * math.sqrt(self.robots / ROBOTS / self.crowding)

    @property
    def steps(self) -> int:
        """Time limit in control steps: that of four robots, and longer as the longest way is."""
        return round(NAVIGATION.steps * max(1.0, self.half_width_m / ARENA_HALF_WIDTH_M))

    @property
    def masses_kg(self) -> tuple[float, ...]:
        """Of the robots; none if all weigh 1 kg."""
        return tuple(MIXED_KG[i % len(MIXED_KG)] for i in range(self.robots)) if self.mixed else ()


class TeamRow(Team, frozen=True, kw_only=True):
    """Means over one seed's episodes; shares in percent, of the episodes if nothing else is said."""

    seed: int
    """Of the policy's training."""
    policy: str
    """Digest of its manifest."""
    episodes: int
    commit: str
    success: float
    """Arrived without a collision, speed limit and margin kept."""
    at_goal: float
    """Robots at their goals when an episode ends, in percent of them."""
    contact: float
    """Two robots touched."""
    speeding: float
    """Share of the robots' steps above the speed limit."""
    margin: float
    """Share of the steps in which two robots were closer than the safety margin."""
    time_to_goal_s: float | None
    """Of the episodes that were satisfied; None without any."""
    failures: dict[str, float]
    """Episodes that were not, by kind: see `benchmarks.paper.oracle.endings`."""
    tick_us: float
    """Median processor time of one robot's tick, of the numpy runtime."""

    @property
    def key(self) -> tuple[Team, str, int]:
        """What makes a row worth keeping."""
        return self.team, self.policy, self.episodes

    @property
    def team(self) -> Team:
        """Whom it is about."""
        return Team(**{name: getattr(self, name) for name in Team.__struct_fields__})


def teams() -> Iterator[tuple[str, list[Team]]]:
    """All teams, by what they show."""
    yield "Size, at the training's density", [Team(robots=size) for size in SIZES]
    large = [size for size in SIZES if size > max(HEARD) + 1]
    heard = [Team(robots=size, neighbours=count) for size in large for count in HEARD]
    yield "Only the nearest heard", heard
    yield "Less room", [Team(robots=8, crowding=crowding) for crowding in NARROW]
    yield "Masses of 0.5, 1 and 2 kg in turn", [Team(robots=size, mixed=True) for size in (4, 8, 16)]
    yield "Teammates seen 10 cm farther away", [Team(robots=n, ease_m=EASE_M) for n in SIZES if n > ROBOTS]
    crowded = [Team(robots=8, crowding=crowding, ease_m=EASE_M) for crowding in NARROW]
    yield "Teammates seen 10 cm farther away, in less room", crowded
    yield "Far places and goals observed as in training", [Team(robots=n, familiar=True) for n in large]
