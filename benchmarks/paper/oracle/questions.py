"""What the oracle asks of a task, row by row, in an order in which later rows build on earlier ones."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.paper.episodes import batches
from benchmarks.paper.evaluation import commit, definition_digest
from benchmarks.paper.methods import decider
from benchmarks.paper.oracle.endings import failures
from benchmarks.paper.oracle.planning import plan, start_of
from benchmarks.paper.oracle.relaxation import never_gathered
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.possible import Ended, Planned, Row, Ruled, ruled_out, unsatisfied
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default
from edge_runtime.policy.bundle import load_bundle
from export.episodes.judges import motion
from export.episodes.neighbourhood import Setting
from export.episodes.play import MakeDecide
from export.scenarios import scenario_facts
from export.scenarios.definitions import SAMPLING

ROUNDS = 200
"""Of search for one episode."""


class Oracle(NamedTuple):
    """One task's question: what is possible in these episodes?"""

    task: str
    setting: Setting
    policies: Path
    seeds: int

    def answers(self, rows: Sequence[Row]) -> list[Row]:
        """Those of the rows that belong to it."""
        asked = self._common
        return [row for row in rows if all(getattr(row, name) == asked[name] for name in asked)]

    def missing(self, rows: Sequence[Row]) -> Iterator[Row]:
        """Find out what the rows do not tell yet, a row at a time.

        Raises:
            ConfigError: if a policy is missing.
        """
        known = self.answers(rows)
        for make in (self._ended, self._ruled, self._planned):
            for row in make(known):
                known.append(row)
                yield row

    def ended(self, rows: Sequence[Row]) -> list[Ended]:
        """How the present policies' episodes ended, by seed."""
        asked = tuned_default(self.task)
        ended = [row for row in self.answers(rows) if isinstance(row, Ended) and row.settings == asked]
        found = {(row.seed, row.policy): row for row in ended}
        keys = [(seed, digest(self._policy(seed))) for seed in range(self.seeds)]
        return [found[key] for key in keys if key in found]

    def _ended(self, known: Sequence[Row]) -> Iterator[Row]:
        have = {row.seed for row in self.ended(known)}
        for seed in range(self.seeds):
            if seed not in have:
                missed = failures(TASKS[self.task], self._decider(seed), self.setting)
                yield Ended(
                    **self._common,
                    commit=commit(),
                    seed=seed,
                    policy=digest(self._policy(seed)),
                    settings=tuned_default(self.task),
                    failures=missed,
                )

    def _ruled(self, known: Sequence[Row]) -> Iterator[Row]:
        if self.task != "sampling" or any(isinstance(row, Ruled) for row in known):
            return
        step, impossible = scenario_facts(self.task).motion.preview(1), []
        for batch in batches(TASKS[self.task], self.setting):
            never = never_gathered(motion(batch.world)[0], SAMPLING, step)
            impossible += (batch.first + np.flatnonzero(never)).tolist()
        yield Ruled(**self._common, commit=commit(), impossible=tuple(impossible))

    def _planned(self, known: Sequence[Row]) -> Iterator[Row]:
        have = {row.episode for row in known if isinstance(row, Planned)}
        todo = unsatisfied(known, self.task) - ruled_out(known, self.task) - have
        deciders = [self._decider(seed) for seed in range(self.seeds)] if todo else []
        for episode in sorted(todo):
            start = start_of(TASKS[self.task], self.setting, episode)
            tried, short = plan(TASKS[self.task], start, deciders, episode, ROUNDS)
            yield Planned(**self._common, commit=commit(), episode=episode, plans=tried, missing=short)

    @property
    def _common(self) -> dict[str, Any]:
        return {
            "task": self.task,
            "definition": definition_digest(self.task),
            "episodes": self.setting.episodes,
            "episodes_seed": self.setting.episodes_seed,
        }

    def _policy(self, seed: int) -> Path:
        return find_policy(self.policies, self.task, tuned_default(self.task).algorithm(self.task), seed)

    def _decider(self, seed: int) -> MakeDecide:
        return decider(TASKS[self.task], tuned_default(self.task), load_bundle(self._policy(seed)))
