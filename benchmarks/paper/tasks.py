"""The three tasks as they are evaluated: objectives, time limit, judge, and the names of Table I."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.paper.judges import BalanceJudge, Judge, NavigationJudge, SamplingJudge
from edge_runtime.objectives import Objective, Passing
from export.scenarios.definitions import (
    BALANCE,
    NAVIGATION,
    SAMPLING,
    BalanceDefinition,
    NavigationDefinition,
    SamplingDefinition,
)


@dataclass(frozen=True)
class Metric:
    """One column of Table II."""

    name: str
    """As in ``paper.json``."""
    title: str
    unit: str
    factor: float
    """From the judge's value to the row's: 100 for what is stated in percent."""
    higher_is_better: bool = False


@dataclass(frozen=True)
class Task:
    """One task of the paper."""

    name: str
    objectives: tuple[Objective, ...]
    steps: int
    """Time limit in control steps."""
    judge: Callable[[int], Judge]
    """Makes a judge of that many episodes."""
    metrics: tuple[Metric, Metric, Metric]
    """Nominal, first and second execution objective."""
    deconfliction: tuple[Objective, ...] = ()
    """What our own methods add so that robots get out of each other's way; nobody is judged by it."""


def navigation(definition: NavigationDefinition) -> Task:
    """Navigation as defined."""
    return Task(
        "navigation",
        definition.objectives,
        definition.steps,
        lambda episodes: NavigationJudge(episodes, definition),
        (
            Metric("navigation_success", "navigation success", "%", 100.0, higher_is_better=True),
            Metric("speeding_violation", "speeding violation", "%", 100.0),
            Metric("margin_violation", "margin violation", "%", 100.0),
        ),
    )


def balance(definition: BalanceDefinition) -> Task:
    """Balance as defined."""
    return Task(
        "balance",
        definition.objectives,
        definition.steps,
        lambda episodes: BalanceJudge(episodes, definition),
        (
            Metric("payload_distance", "payload distance", "m", 1.0),
            Metric("order_violation", "order violation", "%", 100.0),
            Metric("spacing_stddev", "spacing deviation", "m", 1.0),
        ),
        (Passing(order=definition.spatial_order.order),),
    )


def sampling(definition: SamplingDefinition) -> Task:
    """Sampling as defined."""
    return Task(
        "sampling",
        definition.objectives,
        definition.steps,
        lambda episodes: SamplingJudge(episodes, definition),
        (
            Metric("mean_samples", "mean samples", "1", 1.0, higher_is_better=True),
            Metric("geofencing_violation", "geofencing violation", "%", 100.0),
            Metric("cluster_rmse", "cluster RMSE", "m", 1.0),
        ),
    )


TASKS = {task.name: task for task in (navigation(NAVIGATION), balance(BALANCE), sampling(SAMPLING))}
