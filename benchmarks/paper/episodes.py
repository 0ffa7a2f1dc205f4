"""Fresh episodes in VMAS, every action computed by the deployed runtime."""

from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple

import numpy as np
import torch

from benchmarks.paper.tasks import Task
from export.episodes.judges import Outcome
from export.episodes.neighbourhood import Setting
from export.episodes.play import MakeDecide, Watch, nobody, play
from export.scenarios import make_scenario
from export.scenarios.scenario import Scenario

CHUNK = 500
"""Episodes that run side by side."""


class Batch(NamedTuple):
    """Episodes at their start, side by side."""

    first: int
    """Number of the first one."""
    seed: int
    """Of the starts; of noise and lost messages, too."""
    world: Scenario


def batches(task: Task, setting: Setting) -> Iterator[Batch]:
    """The episodes of a setting, in their order."""
    for first in range(0, setting.episodes, CHUNK):
        count, seed = min(CHUNK, setting.episodes - first), setting.episodes_seed * 10_000 + first
        yield Batch(first, seed, make_scenario(task.name, count, seed, torch.device("cpu"), training=False))


def run_episodes(task: Task, make_decide: MakeDecide, setting: Setting, watch: Watch = nobody) -> Outcome:
    """Run and judge fresh episodes.

    Args:
        task: what is played.
        make_decide: who plays.
        setting: how often, and from which seed.
        watch: looks on.
    """
    outcomes = []
    for _, seed, world in batches(task, setting):
        judge = task.judge(world.environments)
        play(world, make_decide, judge, setting, task.steps, seed, watch)
        outcomes.append(judge.outcome())
    names = [field.name for field in fields(Outcome)]
    return Outcome(*(np.concatenate([getattr(one, name) for one in outcomes]) for name in names))
