"""By how much plans fall short of a task's frozen definition: zero where the judge is satisfied.

- Navigation: the robots' mean distance in metres outside their goals' tolerance, where it was least.
- Balance: what is missing in metres, where it was least: of the payload's way, of every robot's place in the
  order and of its distance to its closest neighbour.
- All: every limit of the whole episode that is exceeded, by what share of it.
"""

from collections.abc import Callable

import numpy as np

from benchmarks.paper.tasks import Task
from edge_runtime.common.arrays import Floats
from export.episodes.judges import Flags, Outcome, motion, spacing_errors
from export.scenarios.balance import ON_GOAL_M
from export.scenarios.definitions import BALANCE, NAVIGATION, SAMPLING
from export.scenarios.navigation import GOAL_TOLERANCE_M
from export.scenarios.scenario import Scenario, Transition

UNSATISFIED = 1e-9
"""Least shortfall of what the judge does not accept."""


class Shortfall:
    """Follows P plans of one episode: a `benchmarks.paper.judges.Follower`."""

    def __init__(self, task: Task, plans: int) -> None:
        self.running: Flags = np.ones(plans, bool)
        self._judge, (self._now, self._whole) = task.judge(plans), MEASURES[task.name]
        self._least = np.full(plans, np.inf)

    def add(self, world: Scenario, transition: Transition) -> None:
        """Take one control step into account."""
        self._judge.add(world, transition)
        self.running = self._judge.running
        self._least = np.where(self.running, np.minimum(self._least, self._now(world)), self._least)

    def missing(self) -> Floats:
        """The shortfall of each plan, (P,)."""
        outcome = self._judge.outcome()
        short = np.maximum(self._least + self._whole(outcome), UNSATISFIED)
        return np.where(outcome.satisfied, 0.0, short)


def _to_goals(world: Scenario) -> Floats:
    position, _ = motion(world)
    distance = np.linalg.norm(position - world.state_dict()["goal"].double().numpy(), axis=-1)
    return _over(distance, GOAL_TOLERANCE_M).mean(-1)


def _violated(outcome: Outcome) -> Floats:
    limit = NAVIGATION.tolerance
    return (_over(outcome.first, limit) + _over(outcome.second, limit)) / limit


def _out_of_balance(world: Scenario) -> Floats:
    position, _ = motion(world)
    x = position[:, list(BALANCE.spatial_order.order), 0]
    payload = _over(world.nominal().double().numpy(), ON_GOAL_M)
    spacing = _over(spacing_errors(position, BALANCE), BALANCE.spacing_tolerance_m)
    return payload + _over(-np.diff(x), 0.0).sum(1) + spacing.sum(1)


def _of_sampling(outcome: Outcome) -> Floats:
    return (
        _over(SAMPLING.enough_samples, outcome.nominal) / SAMPLING.enough_samples
        + _over(outcome.first, SAMPLING.tolerance) / SAMPLING.tolerance
        + _over(outcome.second, SAMPLING.cluster_tolerance_m) / SAMPLING.cluster_tolerance_m
    )


def _over(value: Floats | float, limit: Floats | float) -> Floats:
    return np.maximum(np.subtract(value, limit), 0.0)


def _nothing(_outcome: Outcome) -> Floats:
    return np.zeros(1)


def _at_no_moment(_world: Scenario) -> Floats:
    return np.zeros(1)


Measure = tuple[Callable[[Scenario], Floats], Callable[[Outcome], Floats]]
"""What is missing in a state, and of a whole episode."""
MEASURES: dict[str, Measure] = {
    "navigation": (_to_goals, _violated),
    "balance": (_out_of_balance, _nothing),
    "sampling": (_at_no_moment, _of_sampling),
}
