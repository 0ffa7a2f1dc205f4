"""Tables II and III in Markdown, with the paper's own numbers, the deviations and the tests."""

from collections.abc import Sequence

from benchmarks.common.result_page import table
from benchmarks.paper import possible
from benchmarks.paper.candidates import ALONE, METHODS
from benchmarks.paper.rows import Row
from benchmarks.paper.statistics import equivalence, summarise, welch
from benchmarks.paper.tasks import TASKS, Metric

PAPER_SUCCESS = {
    "CFPG": (88.71, 38.20, 71.00),
    "CFPG (No HGP)": (89.14, 35.10, 61.20),
    "MAPPO+PGD": (59.64, 1.30, 50.80),
    "MAPPO+SHLD": (47.32, 3.60, 60.20),
    "PC-MAPPO": (76.24, 0.00, 24.50),
}
"""Table III: multi-objective success in percent, tasks in the order of `TASKS`."""


def success_table(rows: Sequence[Row]) -> str:
    """Table III: multi-objective success, the paper's value in brackets, p against CFPG."""
    lines = []
    for method in METHODS:
        cells = [_success_cell(rows, task, method, place) for place, task in enumerate(TASKS)]
        lines.append([method, *cells])
    return table(["method", *TASKS], lines)


def share_table(rows: Sequence[Row], oracle: Sequence[possible.Row]) -> str:
    """Success as a share of what is possible at least, see `possible`; empty where nobody knows that."""
    bounds = {task: possible.possible(_of_these(oracle, rows, task), task) for task in TASKS}
    if not any(bounds.values()):
        return ""
    lines = [
        [method, *(_share_cell(rows, task, method, bounds[task]) for task in TASKS)] for method in METHODS
    ]
    known = [f"{one.at_least:.1f} to {one.at_most:.1f}" if one else "unknown" for one in bounds.values()]
    return table(["method", *TASKS], [*lines, ["possible, % of all episodes", *known]])


def metrics_table(rows: Sequence[Row], task: str) -> str:
    """One task of Table II."""
    metrics = TASKS[task].metrics
    lines = []
    for method in (*METHODS, *ALONE):
        own = [row for row in rows if (row.task, row.method) == (task, method)]
        if own:
            lines.append([method, str(own[0].settings), *(_metric_cell(own, metric) for metric in metrics)])
    return table(["method", "mode", *(f"{metric.title}, {metric.unit}" for metric in metrics)], lines)


def tests_table(rows: Sequence[Row]) -> str:
    """CFPG's success against every other method: Welch's t-test, and equivalence where it is no better."""
    lines = []
    for method in METHODS[1:]:
        cells = [_test_cell(_successes(rows, task, "CFPG"), _successes(rows, task, method)) for task in TASKS]
        lines.append([method, *cells])
    return table(["CFPG against", *TASKS], lines)


def _of_these(oracle: Sequence[possible.Row], rows: Sequence[Row], task: str) -> list[possible.Row]:
    """What the oracle says of the very episodes that a task's rows are about."""
    asked = {(row.definition, row.episodes, row.episodes_seed) for row in rows if row.task == task}
    return [row for row in oracle if (row.definition, row.episodes, row.episodes_seed) in asked]


def _successes(rows: Sequence[Row], task: str, method: str) -> list[float]:
    return [row.multi_objective_success for row in rows if (row.task, row.method) == (task, method)]


def _success_cell(rows: Sequence[Row], task: str, method: str, place: int) -> str:
    values = _successes(rows, task, method)
    if not values:
        return "not run"
    paper = PAPER_SUCCESS.get(method)
    return f"{summarise(values)}" + (f" ({paper[place]:.1f})" if paper else "")


def _share_cell(rows: Sequence[Row], task: str, method: str, bound: possible.Possible | None) -> str:
    values = _successes(rows, task, method)
    return (
        str(summarise([100.0 * value / bound.at_least for value in values]))
        if bound and values
        else "unknown"
    )


def _metric_cell(rows: Sequence[Row], metric: Metric) -> str:
    summary = summarise([getattr(row, metric.name) for row in rows])
    digits = 3 if metric.unit == "m" else 1
    spread = f" ± {summary.deviation:.{digits}f}" if summary.seeds > 1 else ""
    return f"{summary.mean:.{digits}f}{spread}"


def _test_cell(ours: Sequence[float], theirs: Sequence[float]) -> str:
    if min(len(ours), len(theirs)) < 2:
        return ""
    cell = f"p = {welch(ours, theirs):.1e}"
    same = equivalence(ours, theirs)
    return f"{cell}, equivalence p = {same:.1e}" if same < 0.05 else cell
