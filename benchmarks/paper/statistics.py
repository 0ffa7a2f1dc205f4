"""The paper's statistics over seeds: deviation, Welch's t-test, two one-sided tests of equivalence."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

EQUIVALENCE_MARGIN = 5.0
"""Percentage points within which two success rates count as equal; the paper does not state its own."""


@dataclass(frozen=True)
class Summary:
    """Mean and sample deviation over seeds."""

    mean: float
    deviation: float
    seeds: int

    def __str__(self) -> str:
        return f"{self.mean:.1f} ± {self.deviation:.1f}" if self.seeds > 1 else f"{self.mean:.1f}"


def summarise(values: Sequence[float]) -> Summary:
    """One value a seed; a single seed has no deviation."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
    return Summary(float(np.mean(values)), deviation, len(values))


def welch(one: Sequence[float], other: Sequence[float]) -> float:
    """Two-sided p-value of equal means, the variances unequal; nan with fewer than two seeds."""
    if min(len(one), len(other)) < 2:
        return float("nan")
    if np.ptp(one) == np.ptp(other) == 0.0:
        return float(one[0] == other[0])
    return float(stats.ttest_ind(one, other, equal_var=False).pvalue)


def equivalence(one: Sequence[float], other: Sequence[float], margin: float = EQUIVALENCE_MARGIN) -> float:
    """The greater p-value of two one-sided Welch tests that the means differ by ``margin`` or more."""
    if min(len(one), len(other)) < 2:
        return float("nan")
    shifted = np.asarray(one)
    above = stats.ttest_ind(shifted + margin, other, equal_var=False, alternative="greater").pvalue
    below = stats.ttest_ind(shifted - margin, other, equal_var=False, alternative="less").pvalue
    return float(max(above, below))


def paired(differences: Sequence[float]) -> tuple[float, float]:
    """Mean and its standard error of differences between pairs; nan with fewer than two."""
    error = float(stats.sem(differences)) if len(differences) > 1 else float("nan")
    return float(np.mean(differences)), error


def paired_equivalence(differences: Sequence[float], margin: float) -> float:
    """The greater p-value of two one-sided t-tests that pairs differ by ``margin`` or more in the mean."""
    mean, error = paired(differences)
    if error == 0.0:
        return float(abs(mean) >= margin)
    return float(stats.t.sf((margin - abs(mean)) / error, len(differences) - 1))
