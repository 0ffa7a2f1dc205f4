"""How often a guided policy does all that is asked of it, on tuning episodes that ask in several ways."""

from dataclasses import dataclass
from typing import Final

import torch
from msgspec.structs import replace

from edge_runtime.guidance.guide import Guide, make_guide
from edge_runtime.policy.numpy_policy import FlowPolicy
from export.algorithms.base import Algorithm
from export.common.distributed import CPU, Workers
from export.episodes.carried import carrying
from export.episodes.judges import make_judge
from export.episodes.neighbourhood import Setting
from export.episodes.play import play, sampled
from export.episodes.varied import Varied, varied
from export.scenarios import make_scenario
from export.scenarios.scenario import Scenario

GROUPS: Final = 4
"""Ways of asking."""
TUNING_SEED: Final = 40_000
"""Of what is asked, of the starts and of the noise; the group's number is added."""


@dataclass(frozen=True)
class _Group:
    """Episodes that ask for the same."""

    seed: int
    task: Varied
    world: Scenario
    beginning: dict[str, object]


class GuidedValidation:
    """The same episodes every time, their groups dealt out to the workers."""

    def __init__(self, task: str, episodes: int, workers: Workers) -> None:
        self._workers = workers
        seeds = range(TUNING_SEED + workers.rank, TUNING_SEED + GROUPS, workers.count)
        self._groups = [_group(task, episodes // GROUPS, seed) for seed in seeds]

    def run(self, algorithm: Algorithm) -> float:
        """Return the share of all workers' episodes that satisfy task and execution objectives at once."""
        shares = [_success(group, algorithm) for group in self._groups]
        total = self._workers.mean(torch.tensor(shares, device=self._workers.device).sum())
        return float(total) * self._workers.count / GROUPS


def _group(task: str, episodes: int, seed: int) -> _Group:
    world = make_scenario(task, episodes, seed, CPU, training=False)
    return _Group(seed, varied(task, seed), world, world.state_dict())


def _success(group: _Group, algorithm: Algorithm) -> float:
    flow, world = algorithm.actor.as_flow(), group.world
    weights, steps, judged = flow.to_weights(), algorithm.euler_steps, group.task.definition
    judge = make_judge(judged, world.environments)
    world.load_state_dict(group.beginning)
    decide = sampled(lambda batch: FlowPolicy(weights, steps, batch), _guide(group, algorithm))
    decide = carrying(decide, world.facts)
    heard = Setting(episodes=world.environments, episodes_seed=group.seed)
    play(world, decide, judge, heard, judged.steps, group.seed)
    return float(judge.outcome().satisfied.mean())


def _guide(group: _Group, algorithm: Algorithm) -> Guide:
    asked = group.task.asked
    if algorithm.actor.start == "zero":
        asked = replace(asked, guidance=replace(asked.guidance, start_noise=0.0))
    return make_guide(asked, group.world.facts.motion)
