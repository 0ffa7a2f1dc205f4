"""How episodes end that a guided policy does not satisfy: which condition is missed, and who is merely late.

- Navigation: ``collision``, before all arrived; ``speeding`` and ``margin``, violated too often; ``late``,
  arrived within 5 s more; and by where the robots are then: ``stand-off``, two robots short of their goals
  near each other; ``blocked``, one short of its goal beside one at its goal; ``short``, with nobody near.
- Balance: ``fallen``; ``late``, satisfied within 5 s more; and by what the state at the time limit misses:
  ``payload``, ``order``, ``spacing``.
- Sampling: ``samples``, ``fence``, ``radius``.

What misses several conditions is called by all of them, such as ``samples + radius``.
"""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from benchmarks.paper.episodes import Batch, batches
from benchmarks.paper.tasks import Task
from export.episodes.judges import Flags, Judge, motion, spacing_errors
from export.episodes.neighbourhood import Setting
from export.episodes.play import MakeDecide, play
from export.scenarios.balance import ON_GOAL_M
from export.scenarios.definitions import BALANCE, NAVIGATION, SAMPLING
from export.scenarios.navigation import FACTS, GOAL_TOLERANCE_M
from export.scenarios.scenario import Scenario

GRACE_STEPS = 50
"""Control steps after the time limit."""
NEAR_M = FACTS.body.lidar_range_m + FACTS.body.radius_m + 0.05
"""Between the centres of robots that hold each other off: a little more than one sees of the other."""

Failures = dict[str, tuple[int, ...]]
"""Numbers of the episodes that were not satisfied, by kind."""
PlayOn = Callable[[], Flags]
"""Plays the grace time; says which episodes (E,) are satisfied in it."""


def failures(task: Task, make_decide: MakeDecide, setting: Setting) -> Failures:
    """Play episodes as the tables do, and a little longer."""
    found: dict[str, list[int]] = {}
    for batch in batches(task, setting):
        judge = task.judge(batch.world.environments)
        play(batch.world, make_decide, judge, setting, task.steps, batch.seed)
        kinds = KINDS[task.name](batch.world, judge, partial(_play_on, task, make_decide, setting, batch))
        for number in np.flatnonzero(~judge.outcome().satisfied).tolist():
            found.setdefault(kinds[number], []).append(batch.first + number)
    return {kind: tuple(found[kind]) for kind in sorted(found)}


def _play_on(task: Task, make_decide: MakeDecide, setting: Setting, batch: Batch) -> Flags:
    late = task.judge(batch.world.environments)
    play(batch.world, make_decide, late, setting, GRACE_STEPS, batch.seed)
    return late.outcome().satisfied


def navigation_kinds(world: Scenario, judge: Judge, play_on: PlayOn) -> list[str]:
    """What each of E episodes of Navigation is called, if it was not satisfied."""
    outcome, limit = judge.outcome(), NAVIGATION.tolerance
    violated = _named({"speeding": outcome.first > limit, "margin": outcome.second > limit})
    touched = ~judge.running & (outcome.nominal == 0.0)
    late = play_on()
    return [
        named or ("collision" if touched[e] else "late" if late[e] else where)
        for e, (named, where) in enumerate(zip(violated, _whereabouts(world), strict=True))
    ]


def _whereabouts(world: Scenario) -> list[str]:
    position, _ = motion(world)
    goal = world.state_dict()["goal"].double().numpy()
    short = np.linalg.norm(position - goal, axis=-1) > GOAL_TOLERANCE_M
    apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
    near = (apart < NEAR_M) & ~np.eye(position.shape[1], dtype=bool)
    both, beside = near & short[:, :, None] & short[:, None], near & short[:, :, None]
    kinds = np.where(beside.any((1, 2)), "blocked", "short")
    return [str(kind) for kind in np.where(both.any((1, 2)), "stand-off", kinds)]


def _balance(world: Scenario, judge: Judge, play_on: PlayOn) -> list[str]:
    outcome, fallen = judge.outcome(), ~judge.running
    position, _ = motion(world)
    missed = _named(
        {
            "payload": outcome.nominal >= ON_GOAL_M,
            "order": outcome.first > 0.0,
            "spacing": (spacing_errors(position, BALANCE) > BALANCE.spacing_tolerance_m).any(1),
        }
    )
    late = play_on()
    return ["fallen" if fallen[e] else "late" if late[e] else named for e, named in enumerate(missed)]


def _sampling(_world: Scenario, judge: Judge, _play_on: PlayOn) -> list[str]:
    outcome = judge.outcome()
    return _named(
        {
            "samples": outcome.nominal < SAMPLING.enough_samples,
            "fence": outcome.first > SAMPLING.tolerance,
            "radius": outcome.second > SAMPLING.cluster_tolerance_m,
        }
    )


def _named(missed: Mapping[str, Flags]) -> list[str]:
    """The names of what each of E episodes misses, joined."""
    rows = np.stack(list(missed.values()), -1)
    return [" + ".join(name for name, flag in zip(missed, row, strict=True) if flag) for row in rows.tolist()]


KINDS = {"navigation": navigation_kinds, "balance": _balance, "sampling": _sampling}
