"""The ablation in Markdown: a table a task, every variant with its reason beside its figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.common.result_page import page, table
from benchmarks.paper.ablation.variants import Variant
from benchmarks.paper.rows import Row
from benchmarks.paper.statistics import summarise
from benchmarks.paper.tasks import TASKS, Metric

Answered = Sequence[tuple[Variant, Sequence[Row]]]
"""Variants with their rows, a seed each; the reference first."""
NOTE = """\
Every row changes the tuned default in one point. *Difference*: multi-objective success against the reference,
on the same policies, in percentage points, ± two standard errors over episodes. Projections other than the
default's have the default's eta and noise here; the tables of `paper.md` have each at its own best."""


def write_ablation(tables: Mapping[str, Answered], path: Path) -> str:
    """Write the page; returns it."""
    parts = []
    for task, answered in tables.items():
        parts += [f"## {task.capitalize()}", _circumstances(answered), ablation_table(task, answered)]
    text = page("What each part of the default is good for", "ablation", NOTE, *parts)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return text


def ablation_table(task: str, answered: Answered) -> str:
    """One task's table."""
    metrics, (_, reference) = TASKS[task].metrics, answered[0]
    lines = []
    for variant, rows in answered:
        success = str(summarise([row.multi_objective_success for row in rows]))
        figures = [_metric(rows, metric) for metric in metrics]
        lines.append([variant.name, success, _difference(rows, reference), *figures, variant.reason])
    titles = [f"{metric.title}, {metric.unit}" for metric in metrics]
    return table(["variant", "multi-objective success, %", "difference", *titles, "why"], lines)


def _circumstances(answered: Answered) -> str:
    variant, rows = answered[0]
    seeds = ", ".join(str(row.seed) for row in rows)
    return f"Reference: {variant.settings}. Policies of seeds {seeds}, {rows[0].episodes} episodes each."


def _difference(rows: Sequence[Row], reference: Sequence[Row]) -> str:
    """Mean over the seeds, the errors as of independent episodes; nothing for the reference itself."""
    if rows is reference:
        return ""
    pairs = list(zip(rows, reference, strict=True))
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
