"""The steering experiment in Markdown: a table a scene, a way a line, each at its best scale."""

from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

from benchmarks.common.result_page import page, table
from benchmarks.paper.statistics import summarise
from benchmarks.paper.steering.rows import SteeringRow
from benchmarks.paper.steering.scenes import SCENES

NOTE = """\
Navigation, four robots. *Success*: all at their goals at once in time, without a collision, each objective
that can be kept violated by any robot in at most a tenth of the steps; ± twice the standard error over
episodes. Every way along the flow stands at the best of its scales (eta), by the mean over the policies'
seeds. *Broken*: steps in which any robot violates the objective that is violated most."""
Key = TypeVar("Key", bound=Hashable)


def steering_page(rows: Sequence[SteeringRow]) -> str:
    """The whole page."""
    seeds = ", ".join(sorted({str(row.seed) for row in rows}))
    parts = [NOTE, f"Policies of seeds {seeds}, {rows[0].episodes} episodes of each."]
    for (scene, noise), own in _grouped(rows, lambda row: (row.scene, row.settings.guidance.start_noise)):
        title = f"## {SCENES[scene].title}" + ", the flow started at its mean" * (noise == 0.0)
        parts += [title, scene_table(own)]
    return page("What steering along the flow is for", "steering", *parts)


def scene_table(rows: Sequence[SteeringRow]) -> str:
    """One scene's ways, the best first."""
    lines = []
    for way, own in _grouped(rows, lambda row: row.way):
        tried = [each for _, each in _grouped(own, lambda row: row.settings.guidance.scale)]
        best = max(tried, key=lambda each: _mean(each, "success"))
        eta, count = best[0].settings.guidance.scale, sum(row.episodes for row in best)
        share = _mean(best, "success") / 100.0
        error = 200.0 * (share * (1.0 - share) / count) ** 0.5
        worst = max(_mean_of([row.broken[k] for row in best]) for k in range(len(best[0].broken)))
        cells = [f"{100.0 * share:.1f} ± {error:.1f}", f"{_mean(best, 'arrived'):.1f}", f"{worst:.1f}"]
        lines.append(
            (share, [way, "" if best[0].settings.guidance.mode == "correction" else f"{eta:g}", *cells])
        )
    ordered = [line for _, line in sorted(lines, key=lambda each: -each[0])]
    return table(["way", "eta", "success, %", "arrived, %", "broken, %"], ordered)


def _mean(rows: Sequence[SteeringRow], name: str) -> float:
    return _mean_of([getattr(row, name) for row in rows])


def _mean_of(values: Sequence[float]) -> float:
    return summarise(values).mean


def _grouped(
    rows: Sequence[SteeringRow], key: Callable[[SteeringRow], Key]
) -> list[tuple[Key, list[SteeringRow]]]:
    """Rows in groups of equal keys, in the order in which these come first."""
    keys = list(dict.fromkeys(map(key, rows)))
    return [(one, [row for row in rows if key(row) == one]) for one in keys]
