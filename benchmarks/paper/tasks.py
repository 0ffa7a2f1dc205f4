"""The three tasks as they are evaluated: objectives, time limit, judge, and the names of Table I."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from edge_runtime.objectives import Attraction, Objective, Passing
from export.episodes.belief import RICHEST
from export.episodes.judges import Judge, make_judge
from export.scenarios import scenario_facts
from export.scenarios.definitions import BALANCE, DEFINITIONS, Definition


@dataclass(frozen=True)
class Metric:
    """One column of Table II."""

    name: str
    """As in ``paper.json``."""
    title: str
    unit: str
    factor: float = 1.0
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
    belief: tuple[Objective, ...] = ()
    """What draws robots to where they believe most samples to be left; nobody is judged by it."""

    @property
    def robots(self) -> int:
        """N."""
        return scenario_facts(self.name).robots


METRICS = {
    "navigation": (
        Metric("navigation_success", "navigation success", "%", 100.0, higher_is_better=True),
        Metric("speeding_violation", "speeding violation", "%", 100.0),
        Metric("margin_violation", "margin violation", "%", 100.0),
    ),
    "balance": (
        Metric("payload_distance", "payload distance", "m"),
        Metric("order_violation", "order violation", "%", 100.0),
        Metric("spacing_stddev", "spacing deviation", "m"),
    ),
    "sampling": (
        Metric("mean_samples", "mean samples", "1", higher_is_better=True),
        Metric("geofencing_violation", "geofencing violation", "%", 100.0),
        Metric("cluster_rmse", "cluster RMSE", "m"),
    ),
}
DECONFLICTION = {"balance": (Passing(order=BALANCE.spatial_order.order),)}
BELIEF = {"sampling": (Attraction(object=RICHEST),)}


def make_task(name: str, definition: Definition) -> Task:
    """A task as defined."""
    return Task(
        name,
        definition.objectives,
        definition.steps,
        partial(make_judge, definition),
        METRICS[name],
        DECONFLICTION.get(name, ()),
        BELIEF.get(name, ()),
    )


TASKS = {name: make_task(name, definition) for name, definition in DEFINITIONS.items()}
