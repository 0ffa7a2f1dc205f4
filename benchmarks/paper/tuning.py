"""Choosing every method's settings on episodes and a policy that the tables then leave out of sight.

Each method is tried with its eight settings on the first seed's policy, on episodes of their own seed;
the greatest multi-objective success wins, the better nominal metric decides between equals.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import torch

from benchmarks.paper.candidates import candidates
from benchmarks.paper.contestants import Contestant
from benchmarks.paper.episodes import Setting, run_episodes
from benchmarks.paper.judges import Outcome
from benchmarks.paper.policies import load_policy
from benchmarks.paper.tasks import TASKS, Task
from edge_runtime.errors import ConfigError
from export.atomic import write_atomic

TUNED = Path(__file__).with_name("tuned.json")
TUNING = Setting(episodes=200, seed=900)


class Tried(msgspec.Struct, frozen=True):
    """One setting's figures on the tuning episodes."""

    task: str
    method: str
    mode: str
    multi_objective_success: float
    nominal: float
    """The nominal metric's mean, in the judge's units."""
    chosen: bool = False


def tune(task_name: str, method: str, policies: Path) -> list[Tried]:
    """Try a method's settings on a task and mark the best."""
    torch.set_num_threads(1)
    task, tried = TASKS[task_name], []
    for candidate in candidates(task, method):
        bundle = load_policy(policies, task.name, candidate.algorithm, seed=0)
        tried.append(_tried(task, candidate, run_episodes(task, candidate.make(bundle), TUNING)))
    sign = 1.0 if task.metrics[0].higher_is_better else -1.0
    best = max(tried, key=lambda row: (row.multi_objective_success, sign * row.nominal))
    return [msgspec.structs.replace(row, chosen=row is best) for row in tried]


def chosen(tried: Sequence[Tried], task: Task, method: str) -> Contestant:
    """The contestant that tuning chose.

    Raises:
        ConfigError: if this method was never tuned on this task.
    """
    modes = [row.mode for row in tried if (row.task, row.method, row.chosen) == (task.name, method, True)]
    for candidate in candidates(task, method):
        if candidate.mode in modes:
            return candidate
    raise ConfigError(f"{method} was not tuned on {task.name}: run python -m benchmarks paper --tune")


def read_tuned(path: Path = TUNED) -> list[Tried]:
    """All settings tried so far; none without the file."""
    return msgspec.json.decode(path.read_bytes(), type=list[Tried]) if path.exists() else []


def write_tuned(tried: Sequence[Tried], path: Path = TUNED) -> None:
    """Replace the file, in an order that does not depend on who was ready first."""
    rows = sorted(tried, key=lambda row: (row.task, row.method))
    write_atomic(path, msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")


def _tried(task: Task, candidate: Contestant, outcome: Outcome) -> Tried:
    success = 100.0 * float(outcome.satisfied.mean())
    return Tried(task.name, candidate.method, candidate.mode, success, float(outcome.nominal.mean()))
