"""Budgets: ratios between contenders that a run must reach, each held by so much."""

from collections.abc import Mapping
from pathlib import Path

import msgspec

from benchmarks.latency.measure import Timing
from edge_runtime.common.toml_file import read_toml, to_record
from edge_runtime.errors import ConfigError

BUDGETS = Path(__file__).parents[1] / "budgets.toml"


class Budget(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``backend`` is at least ``at_least`` times as fast as ``against``."""

    backend: str
    against: str
    at_least: float


class BudgetVerdict(msgspec.Struct, frozen=True):
    """A budget beside what was measured."""

    budget: Budget
    reached: float

    @property
    def held(self) -> bool:
        """Whether the budget was reached."""
        return self.reached >= self.budget.at_least

    def __str__(self) -> str:
        budget, share = self.budget, self.reached / self.budget.at_least - 1.0
        outcome = "held by" if self.held else "BROKEN by"
        return (
            f"{budget.backend} over {budget.against}: {self.reached:.3g} times, at least "
            f"{budget.at_least:g} asked, {outcome} {abs(share):.0%}"
        )


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    budgets: list[Budget]


def load_budgets(path: Path = BUDGETS) -> list[Budget]:
    """Read the budgets.

    Raises:
        ConfigError: names the key that is missing or wrong.
    """
    return to_record(read_toml(path), _File, path).budgets


def judge(budgets: list[Budget], timings: Mapping[str, Timing]) -> list[BudgetVerdict]:
    """Compare every budget with a run.

    Raises:
        ConfigError: if a budget names a contender that the run did not time.
    """
    for budget in budgets:
        for name in (budget.backend, budget.against):
            if name not in timings:
                raise ConfigError(f"budgets.toml: {name!r} was not timed, only {', '.join(timings)}")
    return [
        BudgetVerdict(budget, timings[budget.backend].times_faster_than(timings[budget.against]))
        for budget in budgets
    ]
