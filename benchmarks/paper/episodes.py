"""Episodes in VMAS, every action computed by the deployed numpy runtime.

Each robot decides as it would on its own computer: it has its observation, knows its neighbours' states
and the actions that they commanded last, and guides its own flow. Only the loop over robots is batched.
"""

from collections.abc import Callable
from dataclasses import fields

import numpy as np
import torch

from benchmarks.paper.judges import Flags, Follower, Outcome, motion
from benchmarks.paper.methods import MakeDecide
from benchmarks.paper.neighbourhood import Neighbourhood
from benchmarks.paper.rows import Setting
from benchmarks.paper.tasks import Task
from export.scenarios import make_scenario
from export.scenarios.scenario import Scenario

CHUNK = 500
"""Episodes that run side by side."""

Watch = Callable[[Scenario, Flags], None]
"""Sees the scenario before every control step, and which of its episodes (E,) are not over."""


def _nobody(_world: Scenario, _running: Flags) -> None:
    """Look away."""


def run_episodes(task: Task, make_decide: MakeDecide, setting: Setting, watch: Watch = _nobody) -> Outcome:
    """Run and judge fresh episodes.

    Args:
        task: what is played.
        make_decide: who plays.
        setting: how often, and from which seed.
        watch: looks on.
    """
    outcomes = []
    for first in range(0, setting.episodes, CHUNK):
        count, seed = min(CHUNK, setting.episodes - first), setting.episodes_seed * 10_000 + first
        world = make_scenario(task.name, count, seed, torch.device("cpu"), training=False)
        judge = task.judge(count)
        play(world, make_decide, judge, setting, task.steps, seed, watch)
        outcomes.append(judge.outcome())
    names = [field.name for field in fields(Outcome)]
    return Outcome(*(np.concatenate([getattr(one, name) for one in outcomes]) for name in names))


def play(
    world: Scenario,
    make_decide: MakeDecide,
    judge: Follower,
    setting: Setting,
    steps: int,
    seed: int,
    watch: Watch = _nobody,
) -> None:
    """Run the episodes of a world until their judge has seen enough, for ``steps`` at most.

    Args:
        world: E teams of N robots at the start of their episodes.
        make_decide: who plays.
        judge: follows.
        setting: what robots hear of each other.
        steps: time limit.
        seed: of noise and lost messages.
        watch: looks on.
    """
    count, robots, draw = world.environments, world.facts.robots, np.random.default_rng(seed)
    neighbourhood, decide = Neighbourhood(setting, draw), make_decide(count * robots)
    low, high = ([getattr(field, end) for field in world.facts.action] for end in ("low", "high"))
    action = np.zeros((count, robots, 2))
    for _ in range(steps):
        watch(world, judge.running)
        views = neighbourhood.views(*motion(world), action)
        observation = world.observe().flatten(0, 1).numpy()
        action = np.clip(decide(observation, views, draw), low, high).reshape(count, robots, 2)
        judge.add(world, world.step(torch.from_numpy(action).float()))
        if not judge.running.any():
            break
