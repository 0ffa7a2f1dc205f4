"""How much of a task anybody could satisfy: the rows of ``oracle.json``, and the bounds that they give."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmarks.paper.settings import Guided

ORACLE = Path(__file__).parents[1] / "results" / "oracle.json"


class _Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="row"):
    task: str
    definition: str
    """Digest of the task's definition."""
    episodes_seed: int
    episodes: int
    commit: str


class Ended(_Row, frozen=True, kw_only=True, tag="ended"):
    """How the episodes of one seed's guided policy ended."""

    seed: int
    """Of the policy's training."""
    policy: str
    """Digest of its manifest."""
    settings: Guided
    """What guided it."""
    failures: dict[str, tuple[int, ...]]
    """Numbers of the episodes that were not satisfied, by kind: see `oracle.endings`."""

    @property
    def failed(self) -> frozenset[int]:
        """All that were not satisfied."""
        return frozenset(number for numbers in self.failures.values() for number in numbers)


class Ruled(_Row, frozen=True, kw_only=True, tag="ruled"):
    """Which episodes no plan can satisfy, by a relaxation: see `oracle.relaxation`."""

    impossible: tuple[int, ...]


class Planned(_Row, frozen=True, kw_only=True, tag="planned"):
    """What planning found for one episode that no policy satisfied."""

    episode: int
    plans: int
    """Tried, until one satisfied everything or enough were."""
    missing: float
    """By how much the best plan falls short, see `oracle.shortfall`; 0 if it satisfies everything."""


Row = Ended | Ruled | Planned


class Possible(NamedTuple):
    """Shares of a task's episodes, in percent."""

    by_policies: float
    """Satisfied by the policy of one seed or another."""
    at_least: float
    """Those, and what plans satisfy."""
    at_most: float
    """All but what a relaxation rules out."""


def unsatisfied(rows: Sequence[Row], task: str) -> frozenset[int]:
    """The episodes of a task that no policy satisfied."""
    failed = [row.failed for row in rows if isinstance(row, Ended) and row.task == task]
    return frozenset.intersection(*failed) if failed else frozenset()


def ruled_out(rows: Sequence[Row], task: str) -> frozenset[int]:
    """The episodes of a task that nothing can satisfy."""
    ruled = [row.impossible for row in rows if isinstance(row, Ruled) and row.task == task]
    return frozenset(number for numbers in ruled for number in numbers)


def possible(rows: Sequence[Row], task: str) -> Possible | None:
    """Bounds on what is possible; None for a task without rows."""
    own = [row for row in rows if row.task == task]
    if not own:
        return None
    found = {row.episode for row in own if isinstance(row, Planned) and row.missing == 0.0}
    failed = unsatisfied(own, task)
    counts = len(failed), len(failed - found), len(ruled_out(own, task))
    return Possible(*(100.0 * (1.0 - count / own[0].episodes) for count in counts))
