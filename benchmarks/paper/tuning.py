"""Choosing every method's settings on episodes that the tables then leave out of sight.

Each method is tried with its eight settings on the policies of seeds that were trained before definitions and
candidate settings stood, on episodes of their own seed; the greatest multi-objective success wins, the better
nominal metric decides between equals.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import torch

from benchmarks.common.result_file import read_result, write_result
from benchmarks.paper.candidates import candidates
from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import decider
from benchmarks.paper.policies import FIRST_FRESH_SEED, find_policy
from benchmarks.paper.settings import Guided, Settings
from benchmarks.paper.tasks import TASKS, Task
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import load_bundle
from export.episodes.judges import Outcome
from export.episodes.neighbourhood import Setting

TUNED = Path(__file__).with_name("tuned.json")
TUNING = Setting(episodes=100, episodes_seed=900)
"""Of each policy."""


class Tried(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One setting's figures on the tuning episodes."""

    task: str
    method: str
    settings: Settings
    multi_objective_success: float
    nominal: float
    """The nominal metric's mean, in the judge's units."""
    chosen: bool = False


def tune(task_name: str, method: str, policies: Path) -> list[Tried]:
    """Try a method's settings on a task and mark the best."""
    torch.set_num_threads(1)
    task = TASKS[task_name]
    tried = [_try(task, method, settings, policies) for settings in candidates(method, task_name)]
    sign = 1.0 if task.metrics[0].higher_is_better else -1.0
    best = max(tried, key=lambda row: (row.multi_objective_success, sign * row.nominal))
    return [msgspec.structs.replace(row, chosen=row is best) for row in tried]


def chosen(tried: Sequence[Tried], task: str, method: str) -> Settings:
    """The settings that tuning chose.

    Raises:
        ConfigError: if this method was never tuned on this task.
    """
    for row in tried:
        if (row.task, row.method, row.chosen) == (task, method, True):
            return row.settings
    raise ConfigError(f"{method} was not tuned on {task}: run python -m benchmarks paper --tune")


def tuned_default(task: str) -> Guided:
    """What tuning chose for the runtime's default mode.

    Raises:
        ConfigError: if it was never tuned on this task.
    """
    settings = chosen(read_tuned(), task, "CFPG")
    if not isinstance(settings, Guided):
        raise ConfigError(f"{TUNED}: holds for CFPG on {task} what guides no flow")
    return settings


def read_tuned(path: Path = TUNED) -> list[Tried]:
    """All settings tried so far; none without the file.

    Raises:
        ConfigError: if the file holds something else.
    """
    return read_result(path, list[Tried], default=[])


def write_tuned(tried: Sequence[Tried], path: Path = TUNED) -> None:
    """Replace the file, in an order that does not depend on who was ready first."""
    write_result(path, sorted(tried, key=lambda row: (row.task, row.method)))


def _try(task: Task, method: str, settings: Settings, policies: Path) -> Tried:
    algorithm, played = settings.algorithm(task.name), list[Outcome]()
    for seed in range(FIRST_FRESH_SEED):
        bundle = load_bundle(find_policy(policies, task.name, algorithm, seed))
        played.append(run_episodes(task, decider(task, settings, bundle), TUNING))
    success = 100.0 * float(np.mean([outcome.satisfied for outcome in played]))
    nominal = float(np.mean([outcome.nominal for outcome in played]))
    return Tried(task.name, method, settings, success, nominal)
