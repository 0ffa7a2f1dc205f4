"""Episodes in VMAS, every action computed by the deployed numpy runtime.

Each robot decides as it would on its own computer: it has its observation, knows its neighbours' states
and the actions that they commanded last, and guides its own flow. Only the loop over robots is batched.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
import torch

from benchmarks.paper.judges import Flags, Outcome, motion
from benchmarks.paper.masses import set_masses
from benchmarks.paper.neighbourhood import Neighbourhood
from benchmarks.paper.tasks import Task
from edge_runtime.common.arrays import Floats
from export.evaluation.outlook import TeamBatch
from export.scenarios import make_scenario
from export.scenarios.scenario import Scenario

CHUNK = 500
"""Episodes that run side by side."""

Decide = Callable[[npt.NDArray[np.float32], TeamBatch, np.random.Generator], Floats]
"""Observations (B, O) and views of B robots, and a generator of noise -> actions (B, 2)."""
MakeDecide = Callable[[int], Decide]
"""Prepares the decisions of B robots."""
Watch = Callable[[Scenario, Flags], None]
"""Sees the scenario before every control step, and which of its episodes (E,) are not over."""


@dataclass(frozen=True)
class Setting:
    """Which episodes, and what the robots hear of each other."""

    episodes: int
    seed: int
    """Of starts, goals, noise and lost messages."""
    neighbours: int | None = None
    """K, the nearest at every step; None for all."""
    loss: float = 0.0
    """Share of the messages lost."""
    masses_kg: tuple[float, ...] | None = None
    """Of Navigation's robots; None for the task's own."""


def run_episodes(
    task: Task,
    make_decide: MakeDecide,
    setting: Setting,
    progress: Callable[[int], None] = lambda _: None,
    watch: Watch = lambda _world, _running: None,
) -> Outcome:
    """Run and judge fresh episodes.

    Args:
        task: what is played.
        make_decide: who plays.
        setting: how often, and from which seed.
        progress: called with the number of episodes just finished.
        watch: looks on.
    """
    chunks = []
    for first in range(0, setting.episodes, CHUNK):
        count = min(CHUNK, setting.episodes - first)
        chunks.append(_run_chunk(task, make_decide, setting, count, setting.seed * 10_000 + first, watch))
        progress(count)
    names = [field.name for field in fields(Outcome)]
    return Outcome(*(np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in names))


def _run_chunk(
    task: Task,
    make_decide: MakeDecide,
    setting: Setting,
    count: int,
    seed: int,
    watch: Watch,
) -> Outcome:
    world = make_scenario(task.name, count, seed, torch.device("cpu"), training=False)
    if setting.masses_kg is not None:
        set_masses(world, setting.masses_kg)
    robots, draw = world.facts.robots, np.random.default_rng(seed)
    neighbourhood = Neighbourhood(count, robots, setting.neighbours, setting.loss, draw)
    decide, judge = make_decide(count * robots), task.judge(count)
    low, high = ([getattr(field, end) for field in world.facts.action] for end in ("low", "high"))
    action = np.zeros((count, robots, 2))
    for _ in range(task.steps):
        watch(world, judge.running)
        views = neighbourhood.views(*motion(world), action)
        observation = world.observe().flatten(0, 1).numpy()
        action = np.clip(decide(observation, views, draw), low, high).reshape(count, robots, 2)
        judge.add(world, world.step(torch.from_numpy(action).float()))
        if not judge.running.any():
            break
    return judge.outcome()
