"""The ablation in Markdown: a table a task, every variant with its reason beside its figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.paper.ablation.variants import Variant
from benchmarks.paper.rows import Row
from benchmarks.paper.statistics import summarise
from benchmarks.paper.tables import markdown
from benchmarks.paper.tasks import TASKS, Metric

Answered = Sequence[tuple[Variant, Sequence[Row]]]
"""Variants with the rows found, the reference first."""
HEAD = """\
# What each part of the default is good for

Written by `python -m benchmarks paper --ablation`. Every row changes the tuned default in one point.
*Difference*: multi-objective success against the reference, on the same policies, in percentage points, ±
two standard errors over episodes. Projections other than the default's have the default's eta and noise
here; the tables of `paper.md` have each at its own best."""


def write_ablation(tables: Mapping[str, Answered], path: Path) -> str:
    """Write the page; returns its tables."""
    sections = []
    for task, answered in tables.items():
        sections += [f"## {task.capitalize()}", *_circumstances(answered), ablation_table(task, answered)]
    text = "\n\n".join(sections)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{HEAD}\n\n{text}\n")
    return text


def ablation_table(task: str, answered: Answered) -> str:
    """One task's table; what was not run says so."""
    metrics = TASKS[task].metrics
    reference = {row.seed: row for row in answered[0][1]}
    lines = []
    for variant, rows in answered:
        figures = [_metric(rows, metric) for metric in metrics] if rows else ["" for _ in metrics]
        success = str(summarise(_successes(rows))) if rows else "not run"
        lines.append([variant.name, success, _difference(rows, reference), *figures, variant.reason])
    titles = [f"{metric.title}, {metric.unit}" for metric in metrics]
    return markdown(["variant", "multi-objective success, %", "difference", *titles, "why"], lines)


def _circumstances(answered: Answered) -> list[str]:
    """A sentence about what was run; none if nothing was."""
    variant, rows = answered[0]
    if not rows:
        return []
    seeds = ", ".join(str(row.seed) for row in rows)
    mode = variant.who.mode.removeprefix(f"{variant.name}, of ")
    return [f"Reference: {mode}. Policies of seeds {seeds}, {rows[0].episodes} episodes each."]


def _successes(rows: Sequence[Row]) -> list[float]:
    return [row.multi_objective_success for row in rows]


def _difference(rows: Sequence[Row], reference: Mapping[int, Row]) -> str:
    """Mean over the seeds that both have; the errors as of independent episodes."""
    pairs = [(row, reference[row.seed]) for row in rows if row.seed in reference]
    if not pairs or all(row is other for row, other in pairs):
        return ""
    mean = sum(row.multi_objective_success - other.multi_objective_success for row, other in pairs)
    variance = sum(_variance(row) + _variance(other) for row, other in pairs)
    return f"{mean / len(pairs):+.1f} ± {2.0 * variance**0.5 / len(pairs):.1f}"


def _variance(row: Row) -> float:
    """Of a success in percent, over episodes."""
    share = row.multi_objective_success / 100.0
    return 1e4 * share * (1.0 - share) / row.episodes


def _metric(rows: Sequence[Row], metric: Metric) -> str:
    mean = summarise([getattr(row, metric.name) for row in rows]).mean
    return f"{mean:.{3 if metric.unit == 'm' else 1}f}"
