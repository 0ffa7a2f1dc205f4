"""Deciding for some of B robots: by kinds, or only as long as their episodes last."""

from collections.abc import Sequence

import numpy as np

from edge_runtime.common.arrays import Floats
from export.episodes.judges import Follower
from export.episodes.play import Decide, MakeDecide, Observations
from export.evaluation.outlook import Rows, TeamBatch


def by_kind(deciders: Sequence[MakeDecide], kinds: Sequence[int]) -> MakeDecide:
    """Let each kind of robot decide in its own way.

    Args:
        deciders: who decides for each kind.
        kinds: (N,) of a team's robots; teams stand in consecutive rows.
    """

    def prepare(batch: int) -> Decide:
        own = np.resize(kinds, batch)
        parts = [np.flatnonzero(own == kind) for kind in range(len(deciders))]
        made = [make_decide(len(rows)) for make_decide, rows in zip(deciders, parts, strict=True)]

        def decide(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            action = np.zeros((batch, 2))
            for rows, decide_one in zip(parts, made, strict=True):
                action[rows] = decide_one(seen[rows], views.take(rows), draw)
            return action

        return decide

    return prepare


def while_running(make_decide: MakeDecide, judge: Follower) -> MakeDecide:
    """Decide for those robots alone whose episodes are not over; the others do nothing.

    Args:
        make_decide: who decides, without a memory: it is made anew when half of the robots are left.
        judge: knows which episodes are over.
    """

    def prepare(batch: int) -> Decide:
        left: Rows = np.arange(batch)
        decide = make_decide(batch)

        def decide_while_running(seen: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            nonlocal left, decide
            running = np.flatnonzero(np.repeat(judge.running, batch // len(judge.running)))
            if 0 < len(running) <= len(left) // 2:
                left, decide = running, make_decide(len(running))
            action = np.zeros((batch, 2))
            action[left] = decide(seen[left], views.take(left), draw)
            return action

        return decide_while_running

    return prepare
