"""Table I: what an episode of each task is judged by, and when all of it is satisfied at once.

A judge follows E episodes step by step. Its outcome holds, for each, the three metrics of Table I in the
paper's order and whether the nominal and both execution objectives were satisfied.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from export.scenarios.definitions import (
    BalanceDefinition,
    Definition,
    NavigationDefinition,
    SamplingDefinition,
)
from export.scenarios.scenario import Scenario, Transition

Flags = npt.NDArray[np.bool_]
SINGLE_PRECISION = 1e-6
"""VMAS computes in it: limits are taken as broken beyond this."""


@dataclass(frozen=True)
class Outcome:
    """E judged episodes."""

    nominal: Floats
    """(E,): the nominal objective's metric; a success as 1, a failure as 0."""
    first: Floats
    """(E,): the first execution objective's metric; shares lie in [0, 1]."""
    second: Floats
    """(E,): the second execution objective's metric."""
    satisfied: Flags
    """(E,): all three objectives at once."""


class Follower(Protocol):
    """Follows E episodes."""

    running: Flags
    """(E,): episodes that are not over."""

    def add(self, world: Scenario, transition: Transition) -> None:
        """Take one control step into account."""
        ...


class Judge(Follower, Protocol):
    """Follows E episodes and judges them."""

    def outcome(self) -> Outcome:
        """Judge what was followed."""
        ...


class NavigationJudge:
    """Success, share of the robots' steps above the speed limit, share of steps inside the margin."""

    def __init__(self, definition: NavigationDefinition, episodes: int) -> None:
        self.running = np.ones(episodes, bool)
        self._definition = definition
        self._arrived, self._collided = np.zeros(episodes, bool), np.zeros(episodes, bool)
        self._steps, self._speeding, self._too_close = np.zeros((3, episodes))

    def add(self, world: Scenario, transition: Transition) -> None:
        """Count a step of the episodes whose robots have not all arrived."""
        position, velocity = motion(world)
        limit, margin = self._definition.speed_limit.limit_m_s, self._definition.safety_margin.distance_m
        self._steps += self.running
        speeding = np.linalg.norm(velocity, axis=-1) > limit + SINGLE_PRECISION
        self._speeding += self.running * speeding.mean(1)
        self._too_close += self.running * (pair_distances(position).min(1) < margin - SINGLE_PRECISION)
        self._collided |= self.running & transition.failed.numpy()
        self._arrived |= self.running & transition.succeeded.numpy() & ~self._collided
        self.running &= ~transition.succeeded.numpy()

    def outcome(self) -> Outcome:
        """Satisfied: arrived without a collision, both shares within the tolerance."""
        speeding, too_close = self._speeding / self._steps, self._too_close / self._steps
        tolerance = self._definition.tolerance
        satisfied = self._arrived & (speeding <= tolerance) & (too_close <= tolerance)
        return Outcome(self._arrived.astype(float), speeding, too_close, satisfied)


class BalanceJudge:
    """Payload's distance, order and spacing in the state that ends the episode.

    An episode ends when all three objectives hold, when the payload falls, or at the time limit.
    """

    def __init__(self, definition: BalanceDefinition, episodes: int) -> None:
        self.running = np.ones(episodes, bool)
        self._definition = definition
        self._distance, self._disorder, self._spread = np.zeros((3, episodes))
        self._satisfied = np.zeros(episodes, bool)

    def add(self, world: Scenario, transition: Transition) -> None:
        """Take the new state of the episodes that still run."""
        position, _ = motion(world)
        distance = world.nominal().double().numpy()
        ordered = self._in_order(position)
        on_goal = transition.succeeded.numpy() & ~transition.failed.numpy()
        errors = spacing_errors(position, self._definition)
        spaced = (errors <= self._definition.spacing_tolerance_m).all(1)
        satisfied = on_goal & ordered & spaced
        self._distance[self.running] = distance[self.running]
        self._disorder[self.running] = ~ordered[self.running]
        self._spread[self.running] = pair_distances(position)[self.running].std(1)
        self._satisfied |= self.running & satisfied
        self.running &= ~(satisfied | transition.failed.numpy())

    def outcome(self) -> Outcome:
        """Satisfied: payload on its goal, robots in order, each at its distance, at one moment."""
        return Outcome(self._distance, self._disorder, self._spread, self._satisfied)

    def _in_order(self, position: Floats) -> Flags:
        """Every robot right of its predecessor in the order."""
        x = position[:, list(self._definition.spatial_order.order), 0]
        return (np.diff(x, axis=1) > 0.0).all(1)


class SamplingJudge:
    """Samples, share of the steps with a robot inside the fence, deviation from the cluster radius."""

    def __init__(self, definition: SamplingDefinition, episodes: int) -> None:
        self.running = np.ones(episodes, bool)
        self._definition = definition
        self._steps = 0
        self._gathered, self._inside, self._square = np.zeros((3, episodes))

    def add(self, world: Scenario, _transition: Transition) -> None:
        """Count a step; every episode lasts until the time limit."""
        position, _ = motion(world)
        fence, radius = self._definition.geofence, self._definition.clustering.radius_m
        self._steps += 1
        self._gathered = world.nominal().double().numpy()
        distance = np.linalg.norm(position - np.asarray(fence.centre_m), axis=-1).min(1)
        self._inside += distance < fence.radius_m - SINGLE_PRECISION
        self._square += np.square(cluster_radius(position) - radius)

    def outcome(self) -> Outcome:
        """Satisfied: enough samples, fence and cluster radius within their tolerances."""
        definition = self._definition
        inside, deviation = self._inside / self._steps, np.sqrt(self._square / self._steps)
        satisfied = (
            (self._gathered >= definition.enough_samples)
            & (inside <= definition.tolerance)
            & (deviation <= definition.cluster_tolerance_m)
        )
        return Outcome(self._gathered, inside, deviation, satisfied)


def make_judge(definition: Definition, episodes: int) -> Judge:
    """Make the judge of a task as defined."""
    if isinstance(definition, NavigationDefinition):
        return NavigationJudge(definition, episodes)
    if isinstance(definition, BalanceDefinition):
        return BalanceJudge(definition, episodes)
    if isinstance(definition, SamplingDefinition):
        return SamplingJudge(definition, episodes)
    raise TypeError(f"nothing judges a {type(definition).__name__}")


def motion(world: Scenario) -> tuple[Floats, Floats]:
    """Positions and velocities of all robots, (E, N, 2) each."""
    position, velocity = world.motion()
    return position.double().numpy(), velocity.double().numpy()


def pair_distances(position: Floats) -> Floats:
    """Distances between robots' centres, (E, N (N - 1) / 2)."""
    first, second = np.triu_indices(position.shape[1], 1)
    return np.linalg.norm(position[:, first] - position[:, second], axis=-1)


def cluster_radius(position: Floats) -> Floats:
    """Mean distance of the robots to their centroid, (E,)."""
    return np.linalg.norm(position - position.mean(1, keepdims=True), axis=-1).mean(1)


def spacing_errors(position: Floats, definition: BalanceDefinition) -> Floats:
    """How far every robot's closest neighbour is from the target distance, (E, N)."""
    apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
    apart += np.diag(np.full(apart.shape[1], np.inf))
    return np.abs(apart.min(2) - definition.spacing.distance_m)
