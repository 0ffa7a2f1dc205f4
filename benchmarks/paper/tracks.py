"""One episode of a task, left alone and guided, as pictures show it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import decider
from benchmarks.paper.settings import UNGUIDED, Guided
from benchmarks.paper.tasks import Task
from edge_runtime.common.arrays import Floats
from edge_runtime.policy.bundle import Bundle
from export.episodes.judges import Flags, motion
from export.episodes.neighbourhood import Setting
from export.scenarios.scenario import Scenario

SETTING = Setting(episodes=10, episodes_seed=3)


@dataclass(frozen=True)
class Track:
    """An episode of S control steps, seen before each."""

    position: Floats
    """(S, N, 2)"""
    velocity: Floats
    """(S, N, 2)"""
    states: Sequence[dict[str, Tensor]]
    """The scenario's, S of all episodes."""
    episode: int
    """Which of them."""

    def state(self, name: str) -> Floats | None:
        """What the scenario calls by this name, (S, ..); None where it has no such thing."""
        if name not in self.states[0]:
            return None
        return np.stack([state[name][self.episode].double().numpy() for state in self.states])


def follow(
    task: Task, settings: Guided, bundle: Bundle, setting: Setting = SETTING, longest: int | None = None
) -> tuple[Track, Track]:
    """Follow the first episode that guidance satisfies (the first of all, if none), unguided and guided.

    Both until guidance has satisfied everything, or for ``longest`` steps: what robots do afterwards, no
    objective asks for.
    """
    free, _, _ = _watch(task, UNGUIDED, bundle, setting)
    guided, satisfied, running = _watch(task, settings, bundle, setting)
    episode = int(np.argmax(satisfied))
    shown = min(int(running[:, episode].sum()) + 1, longest or len(running))
    return _track(free[:shown], episode), _track(guided[:shown], episode)


_Seen = tuple[Floats, Floats, dict[str, Tensor]]


def _watch(
    task: Task, settings: Guided, bundle: Bundle, setting: Setting
) -> tuple[list[_Seen], Flags, Flags]:
    """All episodes step by step, which of them (E,) were satisfied, and when (S, E) they ran."""
    seen: list[_Seen] = []
    ran: list[Flags] = []

    def watch(world: Scenario, running: Flags) -> None:
        seen.append((*motion(world), world.state_dict()))
        ran.append(running.copy())

    outcome = run_episodes(task, decider(task, settings, bundle), setting, watch)
    return seen, outcome.satisfied, np.stack(ran)


def _track(seen: Sequence[_Seen], episode: int) -> Track:
    position, velocity, states = zip(*seen, strict=True)
    return Track(np.stack(position)[:, episode], np.stack(velocity)[:, episode], states, episode)
