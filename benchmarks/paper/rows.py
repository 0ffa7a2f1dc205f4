"""The rows of ``paper.json``: a question, and what one policy's episodes answered."""

from typing import Any

import msgspec

from benchmarks.paper.settings import Settings
from benchmarks.paper.tasks import TASKS
from export.episodes.judges import Outcome
from export.episodes.neighbourhood import Setting


class Question(Setting, frozen=True, kw_only=True):
    """What one row is to answer."""

    task: str
    method: str
    """As in the paper."""
    settings: Settings
    seed: int
    """Of the policy's training."""
    euler_steps: int | None = None
    """T of sampler ``euler``; None for the policy's own sampler and steps."""
    exponential_steps: int | None = None
    """T of sampler ``exponential``, in place of both."""


class Key(msgspec.Struct, frozen=True):
    """What makes a row worth keeping: the same question, asked of the same policy."""

    question: Question
    policy: str
    """Digest of its manifest."""
    definition: str
    """Digest of the task's definition."""


class Row(Question, frozen=True, kw_only=True):
    """Means over the episodes of one seed's policy; shares in percent, lengths in metres."""

    multi_objective_success: float
    navigation_success: float | None = None
    speeding_violation: float | None = None
    margin_violation: float | None = None
    payload_distance: float | None = None
    order_violation: float | None = None
    spacing_stddev: float | None = None
    mean_samples: float | None = None
    geofencing_violation: float | None = None
    cluster_rmse: float | None = None
    control_frequency_hz: float | None = None
    """How often one robot could decide on this machine: one over the median duration of a tick."""
    policy: str
    definition: str
    commit: str

    def __post_init__(self) -> None:
        """Refuse what no reader could rely on.

        Raises:
            ValueError: if the task is unknown, or a metric is missing or another task's.
        """
        if self.task not in TASKS:
            raise ValueError(f"unknown task {self.task!r}")
        for name, task in TASKS.items():
            for metric in task.metrics:
                if (getattr(self, metric.name) is None) == (name == self.task):
                    raise ValueError(f"`{metric.name}` does not fit {self.task}")

    @property
    def key(self) -> Key:
        """The question that this row answers."""
        asked = {name: getattr(self, name) for name in Question.__struct_fields__}
        return Key(Question(**asked), self.policy, self.definition)


def make_row(key: Key, outcome: Outcome, commit: str, hz: float | None = None) -> Row:
    """Sum an outcome up."""
    values = (outcome.nominal, outcome.first, outcome.second)
    metrics: dict[str, Any] = {
        metric.name: metric.factor * float(value.mean())
        for metric, value in zip(TASKS[key.question.task].metrics, values, strict=True)
    }
    return Row(
        **msgspec.structs.asdict(key.question),
        **metrics,
        multi_objective_success=100.0 * float(outcome.satisfied.mean()),
        control_frequency_hz=hz,
        policy=key.policy,
        definition=key.definition,
        commit=commit,
    )
