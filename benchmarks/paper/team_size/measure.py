"""How one seed's policy does in one team."""

from collections import Counter
from functools import partial
from itertools import takewhile
from pathlib import Path

import msgspec
import numpy as np
import torch
from msgspec.structs import replace

from benchmarks.paper.evaluation import EVALUATION_SEED, commit
from benchmarks.paper.frequency import tick_s
from benchmarks.paper.methods import decider
from benchmarks.paper.oracle.endings import GRACE_STEPS, navigation_kinds
from benchmarks.paper.policies import digest
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.team_size.teams import Team, TeamRow
from benchmarks.paper.tuning import tuned_default
from edge_runtime.common.arrays import Floats
from edge_runtime.policy.bundle import load_bundle
from export.episodes.judges import Flags, motion
from export.episodes.neighbourhood import Setting
from export.episodes.play import Decide, MakeDecide, Observations, play
from export.evaluation.outlook import TeamBatch
from export.scenarios.navigation import ARENA_HALF_WIDTH_M, FACTS, GOAL_TOLERANCE_M, Navigation
from export.scenarios.scenario import Scenario, Transition

FARTHEST_GOAL_M = 2.0 * ARENA_HALF_WIDTH_M
"""A side of the training's arena."""


def measure(team: Team, seed: int, policy: Path, episodes: int) -> TeamRow:
    """Play and sum up."""
    task, bundle = TASKS["navigation"], load_bundle(policy)
    tuned = tuned_default(task.name)
    eased = replace(tuned, guidance=replace(tuned.guidance, ease_m=team.ease_m))
    make_decide = decider(task, eased, bundle)
    make_decide = familiar(make_decide) if team.familiar else make_decide
    setting = Setting(episodes=episodes, episodes_seed=EVALUATION_SEED, neighbours=team.neighbours)
    noise, world = 10_000 * EVALUATION_SEED, make_world(team, episodes)
    follower = _Follower(episodes)
    play(world, make_decide, follower, setting, team.steps, noise)
    outcome, at_goal = follower.judge.outcome(), _at_goal(world)
    at_goal[~follower.running] = 1.0
    kinds = navigation_kinds(world, follower.judge, partial(_play_on, world, make_decide, setting, noise))
    missed = Counter(kinds[number] for number in np.flatnonzero(~outcome.satisfied))
    took = 0.1 * follower.steps[outcome.satisfied]
    return TeamRow(
        **msgspec.structs.asdict(team),
        seed=seed,
        policy=digest(policy),
        episodes=episodes,
        commit=commit(),
        success=100.0 * float(outcome.satisfied.mean()),
        at_goal=100.0 * float(at_goal.mean()),
        contact=100.0 * float(follower.touched.mean()),
        speeding=100.0 * float(outcome.first.mean()),
        margin=100.0 * float(outcome.second.mean()),
        time_to_goal_s=float(took.mean()) if len(took) else None,
        failures={kind: 100.0 * count / episodes for kind, count in sorted(missed.items())},
        tick_us=1e6 * tick_s(task, bundle, _heard(team)),
    )


def make_world(team: Team, episodes: int) -> Navigation:
    """The team's starts."""
    return Navigation(
        episodes,
        10_000 * EVALUATION_SEED,
        torch.device("cpu"),
        training=False,
        robots=team.robots,
        half_width_m=team.half_width_m,
        masses_kg=team.masses_kg,
    )


def familiar(make_decide: MakeDecide) -> MakeDecide:
    """Decide from observations as near as in training.

    A place beyond the training's arena is observed on its border, and a goal farther than ``FARTHEST_GOAL_M``
    in its direction at that distance, as a waypoint on the way to it would be.
    """
    place, goal = _columns("position"), _columns("goal_offset")

    def prepare(batch: int) -> Decide:
        decide = make_decide(batch)

        def decide_nearby(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            near = seen.copy()
            near[:, place] = near[:, place].clip(-ARENA_HALF_WIDTH_M, ARENA_HALF_WIDTH_M)
            distance = np.linalg.norm(near[:, goal], axis=1, keepdims=True)
            near[:, goal] *= FARTHEST_GOAL_M / np.maximum(distance, FARTHEST_GOAL_M)
            return decide(near, views, draw)

        return decide_nearby

    return prepare


def _columns(name: str) -> slice:
    """Where an observation holds a field."""
    before = [field.size for field in takewhile(lambda field: field.name != name, FACTS.observation)]
    return slice(sum(before), sum(before) + FACTS.observation[len(before)].size)


class _Follower:
    """The task's judge, and what it does not tell."""

    def __init__(self, episodes: int) -> None:
        self.judge = TASKS["navigation"].judge(episodes)
        self.running: Flags = np.ones(episodes, bool)
        self.steps, self.touched = np.zeros(episodes), np.zeros(episodes, bool)

    def add(self, world: Scenario, transition: Transition) -> None:
        self.steps += self.running
        self.touched |= self.running & transition.failed.numpy()
        self.judge.add(world, transition)
        self.running = self.judge.running


def _play_on(world: Navigation, make_decide: MakeDecide, setting: Setting, noise: int) -> Flags:
    late = TASKS["navigation"].judge(world.environments)
    play(world, make_decide, late, setting, GRACE_STEPS, noise)
    return late.outcome().satisfied


def _at_goal(world: Navigation) -> Floats:
    """Share of the robots at their goals, (E,)."""
    position, _ = motion(world)
    goal = world.state_dict()["goal"].double().numpy()
    return (np.linalg.norm(position - goal, axis=-1) < GOAL_TOLERANCE_M).mean(1)


def _heard(team: Team) -> int:
    """Neighbours that guidance hears of."""
    return team.robots - 1 if team.neighbours is None else min(team.neighbours, team.robots - 1)
