"""The teams that are measured, and the rows of ``team_size.json``."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from benchmarks.paper.policies import SEEDS
from benchmarks.paper.settings import Guided
from edge_runtime.observation.border import Arena
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import ARENA_HALF_WIDTH_M, ROBOTS

SIZES = (2, 3, 4, 6, 8, 16, 32)
HEARD = (3, 7)
NARROW = (1.5, 2.0, 3.0)
TRAINING_ARENA = Arena((-ARENA_HALF_WIDTH_M,) * 2, (ARENA_HALF_WIDTH_M,) * 2)
"""Where the training's robots start and have their goals."""
MIXED_KG = (0.5, 1.0, 2.0)
"""Masses of a mixed team's robots, in turn; the policy knows robots of 1 kg."""


class Team(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a team differs from the training's."""

    robots: int
    crowding: float = 1.0
    """Robots per area, as a multiple of the training's."""
    neighbours: int | None = None
    """K, the nearest that guidance hears of; None for all."""
    mixed: bool = False
    """Whether robots weigh `MIXED_KG` in turn."""
    told: bool = True
    """Whether each robot's guidance knows its mass, as by ``mass_kg`` in a fleet file; else 1 kg."""
    eased: bool = True
    """Whether the policy sees teammates farther away than they are, by ``ease_m``."""
    near: bool = False
    """Whether places beyond `TRAINING_ARENA` are observed on its border, as by ``training_arena``."""

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

    def __str__(self) -> str:
        words = [f"{self.robots} robots"]
        words += [f"{self.crowding:g} times as many to the area"] * (self.crowding != 1.0)
        words += [f"K = {self.neighbours}"] * (self.neighbours is not None)
        words += ["each knows its mass" if self.told else "told 1 kg"] * self.mixed
        return ", ".join(words)


class TeamQuestion(Team, frozen=True, kw_only=True):
    """What one row is to answer."""

    settings: Guided
    """By which the flow is guided."""
    seed: int
    """Of the policy's training."""
    policy: str
    """Digest of its manifest."""
    episodes: int
    episodes_seed: int


class TeamRow(TeamQuestion, frozen=True, kw_only=True):
    """Means over one seed's episodes; shares in percent, of the episodes if nothing else is said."""

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
    def question(self) -> TeamQuestion:
        """What it answers."""
        return TeamQuestion(**{name: getattr(self, name) for name in TeamQuestion.__struct_fields__})


class Asked(NamedTuple):
    """A team, and how well it is to be known."""

    team: Team
    seeds: int
    """Policies of so many seeds, from 0 on."""
    episodes: int
    """Of each."""


def chapters() -> dict[str, list[Asked]]:
    """All teams, by what they show."""
    whole = [_whole(Team(robots=size, near=size > ROBOTS)) for size in SIZES]
    far = [_whole(Team(robots=size)) for size in SIZES if size > ROBOTS]
    crowded = [Team(robots=8, crowding=crowding) for crowding in NARROW]
    as_seen = [Team(robots=size, eased=False) for size in SIZES]
    as_seen += [Team(robots=8, crowding=crowding, eased=False) for crowding in NARROW]
    mixed = [Team(robots=size, mixed=True, told=told) for told in (True, False) for size in (4, 8, 16)]
    return {
        "Size, at the training's density": whole,
        "Without training_arena: places beyond the training's observed as they are": far,
        "Only the nearest heard": _glance([Team(robots=16, neighbours=nearest) for nearest in HEARD]),
        "Less room": _glance(crowded),
        "Masses of 0.5, 1 and 2 kg in turn": _glance(mixed),
        "Without ease_m: teammates seen where they are": _glance(as_seen),
    }


def _whole(team: Team) -> Asked:
    return Asked(team, SEEDS, 1000 if team.robots <= 16 else 100)


def _glance(teams: Sequence[Team]) -> list[Asked]:
    return [Asked(team, 2, 100) for team in teams]
