"""Plans for all robots of one episode, made with its whole state known and no limit on computing.

The first plans are what the guided policies of all seeds do, each with several draws of noise. The best of
them are then changed at random, in parallel: for a while, the team's path or one robot's is bent, or the
team drawn together towards its centroid. A path is followed by the forces that lead to its next place, as
far as forces go; what robots do then is the changed plan. It replaces its parent if it falls short by less.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmarks.paper.episodes import batches
from benchmarks.paper.oracle.shortfall import Shortfall
from benchmarks.paper.tasks import Task
from edge_runtime.common.arrays import Floats
from export.episodes.judges import Flags
from export.episodes.neighbourhood import Setting
from export.episodes.play import Decide, MakeDecide, Observations, play
from export.evaluation.outlook import TeamBatch
from export.scenarios import make_scenario, scenario_facts
from export.scenarios.scenario import Scenario, Transition
from export.scenarios.vmas_teams import State

DRAWS = 16
"""Of noise, for each policy."""
PARENTS = 4
"""Plans that are improved side by side."""
CHILDREN = 64
"""Of each in a round."""
LARGEST_M = 0.5
"""Change of a path; the smallest is a hundredth of it."""


@dataclass(frozen=True)
class Plans:
    """P plans of one episode of S steps."""

    path: Tensor
    """(S, P, N, 2), positions after each step."""
    coast: Tensor
    """(S, P, N, 2), where each step would lead without an action."""
    action: Tensor
    """(S, P, N, 2)"""
    missing: Floats
    """(P,), see `shortfall`."""

    def take(self, index: Sequence[int] | np.ndarray) -> "Plans":
        """Some of them."""
        return Plans(self.path[:, index], self.coast[:, index], self.action[:, index], self.missing[index])

    def best(self, count: int) -> "Plans":
        """Those that fall short by least."""
        return self.take(np.argsort(self.missing, kind="stable")[:count])


def joined(parts: Sequence[Plans]) -> Plans:
    """All plans of several sets."""
    names = ("path", "coast", "action")
    rows = (torch.cat([getattr(one, name) for one in parts], 1) for name in names)
    return Plans(*rows, np.concatenate([one.missing for one in parts]))


def sampled(task: Task, start: State, make_decide: MakeDecide, seed: int) -> Plans:
    """What a policy does from a start, with ``DRAWS`` draws of noise."""
    tape = _Tape(task, DRAWS)
    setting = Setting(episodes=DRAWS, episodes_seed=seed)
    world = world_of(task, start, DRAWS)
    play(world, tape.recorded(make_decide), tape, setting, task.steps, seed, tape.look)
    return tape.plans()


def plan(
    task: Task, start: State, policies: Sequence[MakeDecide], seed: int, rounds: int
) -> tuple[int, float]:
    """Plan an episode; returns how many plans were tried, and the least shortfall, 0 if one satisfies all."""
    best = joined([sampled(task, start, one, seed) for one in policies])
    tried, draw = len(best.missing), torch.Generator().manual_seed(seed)
    best = best.best(PARENTS)
    for _ in range(rounds):
        if not best.missing.all():
            break
        best = improved(task, start, best, draw)
        tried += PARENTS * CHILDREN
    return tried, float(best.missing.min())


def improved(task: Task, start: State, parents: Plans, draw: torch.Generator) -> Plans:
    """One round: each parent, or the best of its children if that falls short by less."""
    count = len(parents.missing)
    family = parents.take(np.repeat(np.arange(count), CHILDREN))
    world = world_of(task, start, count * CHILDREN)
    children = followed(task, world, family, changed(family.path, draw))
    own = children.missing.reshape(count, CHILDREN)
    best = children.take(own.argmin(1) + CHILDREN * np.arange(count))
    both, better = joined([parents, best]), best.missing < parents.missing
    return both.take(np.arange(count) + count * better)


def followed(task: Task, world: Scenario, plans: Plans, wanted: Tensor) -> Plans:
    """Follow paths (S, P, N, 2): act as planned, and as leads from the planned path to the wanted one."""
    tape = _Tape(task, world.environments)
    for path, coast, action, place in zip(plans.path, plans.coast, plans.action, wanted, strict=True):
        tape.look(world)
        missing = (place - path) - (tape.coast[-1] - coast)
        tape.act(action + missing / tape.ahead.position_gain)
        tape.add(world, world.step(tape.action[-1]))
    return tape.plans()


def changed(path: Tensor, draw: torch.Generator) -> Tensor:
    """Change each of P paths (S, P, N, 2) for a while: smoothly, by up to ``LARGEST_M``."""
    steps, plans, robots, _ = path.shape
    middle, width, size, kind = torch.rand(4, plans, 1, 1, generator=draw)
    length = steps ** (0.3 + 0.7 * width)
    time = torch.arange(steps, dtype=path.dtype)[:, None, None, None]
    weight = (-0.5 * ((time - middle * steps) / (0.5 * length)) ** 2).exp()
    bend = LARGEST_M * 100.0 ** (size - 1.0) * torch.randn(plans, robots, 2, generator=draw)
    chosen = torch.randint(robots, (plans, 1), generator=draw) == torch.arange(robots)
    alone = torch.where(chosen[..., None], bend, 0.0)
    away = torch.where(kind < 0.5, bend[:, :1].expand_as(bend), alone)
    drawn = torch.rand(plans, 1, 1, generator=draw) * weight * (path.mean(2, keepdim=True) - path)
    return path + torch.where(kind < 0.8, weight * away, drawn)


def start_of(task: Task, setting: Setting, episode: int) -> State:
    """The start of one episode, as `episodes.run_episodes` plays it."""
    batch = next(one for one in batches(task, setting) if episode < one.first + one.world.environments)
    row = episode - batch.first
    state = batch.world.state_dict()
    return {name: value[row : row + 1] for name, value in state.items() if name != "generator"}


def world_of(task: Task, start: State, plans: int) -> Scenario:
    """So many times the same start."""
    world = make_scenario(task.name, plans, 0, torch.device("cpu"), training=False)
    same = {name: value.repeat(plans, *[1] * (value.dim() - 1)) for name, value in start.items()}
    world.load_state_dict({**world.state_dict(), **same})
    return world


class _Tape:
    """Follows plans to the end of the time, and keeps what the robots did."""

    def __init__(self, task: Task, plans: int) -> None:
        self.ahead = scenario_facts(task.name).motion.preview(1)
        self.running: Flags = np.ones(plans, bool)
        self.coast: list[Tensor] = []
        self.action: list[Tensor] = []
        self._path: list[Tensor] = []
        self._short = Shortfall(task, plans)

    def look(self, world: Scenario, _running: object = None) -> None:
        """See a state before its step."""
        position, velocity = world.motion()
        self.coast.append(position + self.ahead.position_decay * velocity)

    def act(self, action: Tensor) -> None:
        """Keep what is done in a step."""
        self.action.append(action.clamp(-1.0, 1.0))

    def add(self, world: Scenario, transition: Transition) -> None:
        """See what a step led to."""
        self._short.add(world, transition)
        self._path.append(world.motion()[0])

    def recorded(self, make_decide: MakeDecide) -> MakeDecide:
        """The same decisions, kept."""

        def prepare(batch: int) -> Decide:
            decide = make_decide(batch)

            def decide_on_tape(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
                action = decide(seen, views, draw)
                self.act(torch.from_numpy(action).float().view(len(self.running), -1, 2))
                return action

            return decide_on_tape

        return prepare

    def plans(self) -> Plans:
        """All that was followed."""
        kept = (torch.stack(rows) for rows in (self._path, self.coast, self.action))
        return Plans(*kept, self._short.missing())
