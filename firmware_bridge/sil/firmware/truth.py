"""What the team did, as the plant knows it: goals, collisions, objectives broken."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from edge_runtime.config.tracked import Tracked
from edge_runtime.messages import Vector2
from edge_runtime.objectives import Objective, SafetyMargin, SpeedLimit
from firmware_bridge.sil.firmware.world import World


class RobotOutcome(msgspec.Struct, frozen=True):
    """One robot's part in a run, from the beginning of the measurement to its end."""

    goal_distance_m: float | None
    """At the end; None for a robot without a goal."""
    collisions: int
    """Contacts with other robots, counted when they begin."""
    obstacle_contacts: int
    """With obstacles, counted alike."""
    violated_s: float
    """Time during which any objective with a limit was broken."""
    least_distance_m: float | None
    """To any other robot's centre; None for a robot alone."""
    greatest_speed_m_s: float


class ObjectOutcome(msgspec.Struct, frozen=True):
    """How near a tracked object that has a goal came to it, in the same time."""

    name: str
    goal_distance_m: float
    """At the end."""
    least_goal_distance_m: float


class Truth:
    """Follows the plant step by step; speed limits and safety margins are judged, nothing else has a limit.

    Args:
        world: the plant.
        goals_m: of the robots, in its order; None for one that has none.
        objectives: what the team is asked.
        period_s: of one step.
        tracked: the objects, in its order.
    """

    def __init__(
        self,
        world: World,
        goals_m: Sequence[Vector2 | None],
        objectives: Sequence[Objective],
        period_s: float,
        tracked: Sequence[Tracked] = (),
    ) -> None:
        robots = len(goals_m)
        self._world, self._goals_m, self._period_s = world, goals_m, period_s
        self._speed_m_s = min(
            (o.limit_m_s for o in objectives if isinstance(o, SpeedLimit)), default=math.inf
        )
        self._margin_m = max((o.distance_m for o in objectives if isinstance(o, SafetyMargin)), default=0.0)
        self._touching = np.zeros((robots, robots), bool)
        self._bumping = np.zeros_like(world.bumping())
        self._collisions, self._bumps = np.zeros((2, robots), np.int64)
        self._violated_steps = np.zeros(robots, np.int64)
        self._least = np.full(robots, math.inf)
        self._greatest = np.zeros(robots)
        self._carried = [(n, each.name, each.goal_m) for n, each in enumerate(tracked) if each.goal_m]
        self._least_away_m = [math.inf] * len(self._carried)

    def follow(self) -> None:
        """Take the step just done into account."""
        distances, speeds = self._world.distances_m(), self._world.speeds_m_s()
        touching = self._world.touching()
        self._collisions += (touching & ~self._touching).sum(1)
        self._touching = touching
        bumping = self._world.bumping()
        self._bumps += (bumping & ~self._bumping).sum(1)
        self._bumping = bumping
        nearest = distances.min(1)
        self._violated_steps += (speeds > self._speed_m_s) | (nearest < self._margin_m)
        self._least = np.minimum(self._least, nearest)
        self._greatest = np.maximum(self._greatest, speeds)
        self._least_away_m = list(map(min, self._least_away_m, self._away_m()))

    def outcomes(self) -> tuple[RobotOutcome, ...]:
        """Sum up, in the world's order."""
        places = self._world.position_m.tolist()
        return tuple(
            RobotOutcome(
                None if goal_m is None else math.dist(places[robot], goal_m),
                int(self._collisions[robot]),
                int(self._bumps[robot]),
                float(self._violated_steps[robot] * self._period_s),
                float(self._least[robot]) if math.isfinite(self._least[robot]) else None,
                float(self._greatest[robot]),
            )
            for robot, goal_m in enumerate(self._goals_m)
        )

    def objects(self) -> tuple[ObjectOutcome, ...]:
        """Tell of the objects that have goals."""
        outcomes = zip(self._carried, self._away_m(), self._least_away_m, strict=True)
        return tuple(ObjectOutcome(name, away_m, least_m) for (_, name, _), away_m, least_m in outcomes)

    def _away_m(self) -> list[float]:
        motions = self._world.objects() if self._carried else ()
        return [math.dist(motions[place].position_m, goal_m) for place, _, goal_m in self._carried]
