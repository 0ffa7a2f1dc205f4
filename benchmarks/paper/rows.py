"""The rows of ``paper.json``: one for every task, method, mode and seed."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmarks.paper.judges import Outcome
from benchmarks.paper.tasks import Task
from edge_runtime.errors import ConfigError


class Row(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Means over the episodes of one seed's policy; shares in percent, lengths in metres."""

    task: str
    method: str
    """As in the paper."""
    mode: str
    """Of guidance or of post-processing, with its settings."""
    seed: int
    """Of the policy's training."""
    episodes: int
    episodes_seed: int
    """Of their starts, goals and noise."""
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
    euler_steps: int | None = None
    """T, where it is not the policy's own."""
    neighbours: int | None = None
    """K, where not all teammates were heard."""
    loss: float = 0.0
    """Share of the messages lost."""
    control_frequency_hz: float | None = None
    """How often one robot could decide on this machine: one over the median duration of a tick."""
    policy: str
    """Digest of the policy's manifest."""
    definitions: str
    """Digest of the tasks' definitions."""
    commit: str

    @property
    def key(self) -> "Key":
        """The question that this row answers."""
        return Key(
            self.task,
            self.method,
            self.mode,
            self.seed,
            self.episodes,
            self.episodes_seed,
            self.euler_steps,
            self.neighbours,
            self.loss,
            self.policy,
            self.definitions,
        )


class Key(NamedTuple):
    """What makes a row worth keeping: the same question, asked of the same policy."""

    task: str
    method: str
    mode: str
    seed: int
    episodes: int
    episodes_seed: int
    euler_steps: int | None
    neighbours: int | None
    loss: float
    policy: str
    definitions: str


def make_row(task: Task, outcome: Outcome, key: Key, commit: str, hz: float | None = None) -> Row:
    """Sum an outcome up."""
    values = (outcome.nominal, outcome.first, outcome.second)
    metrics = {
        metric.name: metric.factor * float(value.mean())
        for metric, value in zip(task.metrics, values, strict=True)
    }
    success = 100.0 * float(outcome.satisfied.mean())
    return Row(
        **key._asdict(), multi_objective_success=success, commit=commit, control_frequency_hz=hz, **metrics
    )


def read_rows(path: Path) -> list[Row]:
    """Rows of an earlier run; none if there is no such file.

    Raises:
        ConfigError: if the file holds something else.
    """
    if not path.exists():
        return []
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Row])
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(f"{path}: holds no rows of this benchmark ({error}): move it away") from error


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Replace the file at once, so that an interruption leaves the old rows or the new ones.

    Raises:
        ConfigError: if it cannot be written.
    """
    part = path.with_suffix(".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from error
