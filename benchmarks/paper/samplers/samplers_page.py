"""Samplers in Markdown: a table a task."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from benchmarks.common.result_page import page, table
from benchmarks.paper.rows import Row
from benchmarks.paper.statistics import paired, paired_equivalence, summarise

MARGIN = 1.0
"""Percentage points within which two successes count as equal."""
NOTE = f"""\
Guidance as tuned; policies and episodes are those of `paper.md`'s tables. *Difference*: success less that
of Euler's ten steps of the same policy, mean over the policies ± its standard error; *equivalent*: the
p-value of two one-sided paired t-tests that it is {MARGIN:g} point or more."""


def write_samplers(tables: Mapping[str, Sequence[Row]], path: Path) -> str:
    """Write the page; a task's rows stand way by way, Euler's first. Returns it."""
    parts = []
    for task, rows in tables.items():
        parts += [f"## {task.capitalize()}", samplers_table(rows)]
    text = page("Few steps of the exponential sampler", "samplers", NOTE, *parts)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return text


def samplers_table(rows: Sequence[Row]) -> str:
    """One task's table."""
    ways = [(way, [row.multi_objective_success for row in group]) for way, group in groupby(rows, _way)]
    reference = ways[0][1]
    lines = [[*way, *_figures(successes, reference)] for way, successes in ways]
    return table(["sampler", "T", "multi-objective success, %", "difference", "equivalent"], lines)


def _way(row: Row) -> tuple[str, ...]:
    return ("exponential", str(row.exponential_steps)) if row.exponential_steps else ("euler", "10")


def _figures(successes: Sequence[float], reference: Sequence[float]) -> list[str]:
    if successes is reference:
        return [str(summarise(successes)), "", ""]
    differences = [one - other for one, other in zip(successes, reference, strict=True)]
    mean, error = paired(differences)
    p = paired_equivalence(differences, MARGIN)
    return [str(summarise(successes)), f"{mean:+.2f} ± {error:.2f}", f"p = {p:.2g}"]
