"""``python -m benchmarks curves``: the algorithms' learning, from the runs that ``export.train_all`` left.

Writes the validated points to ``benchmarks/results/paper/curves.csv``, where those of other tasks and
algorithms stay, and draws all of them beside it: the mean over five seeds, and the range between the worst
and the best.
"""

import csv
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np

from benchmarks.common.flags import make_parser
from benchmarks.paper.tasks import TASKS
from edge_runtime.errors import ConfigError
from export.training.validation import GUIDED_SHARE

mpl.use("Agg")
from matplotlib import pyplot as plt

OUT = Path(__file__).parents[1] / "results" / "paper"
COLOURS = {
    "mafpo": ("#d55e00", "mafpo (eqs. 8, 9)"),
    "mafpo-chain": ("#0072b2", "mafpo-chain"),
    "mappo": ("#009e73", "mappo"),
}
"""What learns the task alone, and from nothing."""
SEEDS = 5
"""Of each."""


class Point(NamedTuple):
    """One validation of a policy alone: the same starts for all, half with the flow's noise, half without."""

    task: str
    algorithm: str
    seed: int
    frames: int
    score: float


def read_points(runs: Path) -> list[Point]:
    """All validations of the first seeds under ``runs/<task>/<algorithm>/seed-<n>``.

    Raises:
        ConfigError: if there are none.
    """
    points = []
    for table in sorted(runs.glob("*/*/seed-*/metrics.csv")):
        task, algorithm, seed = table.parts[-4], table.parts[-3], int(table.parts[-2].removeprefix("seed-"))
        if task in TASKS and algorithm in COLOURS and seed < SEEDS:
            with table.open() as lines:
                rows = [row for row in csv.DictReader(lines) if row["score"]]
            alone = _alone if any(row["guided_success"] for row in rows) else _score
            points += [Point(task, algorithm, seed, int(row["frames"]), alone(row)) for row in rows]
    if not points:
        raise ConfigError(f"{runs}: holds no metrics.csv of a run: make them with python -m export.train_all")
    return points


def _score(row: Mapping[str, str]) -> float:
    return float(row["score"])


def _alone(row: Mapping[str, str]) -> float:
    """The score of the policy alone, from one that counts guided episodes, too."""
    return (_score(row) - GUIDED_SHARE * float(row["guided_success"] or 0.0)) / (1.0 - GUIDED_SHARE)


def _others(path: Path, learned: set[tuple[str, str]]) -> list[Point]:
    """The points in the file that are of none of these tasks and algorithms."""
    if not path.exists():
        return []
    with path.open() as lines:
        rows = [row for row in csv.DictReader(lines) if (row["task"], row["algorithm"]) not in learned]
    return [
        Point(row["task"], row["algorithm"], int(row["seed"]), int(row["frames"]), float(row["score"]))
        for row in rows
    ]


def draw(points: Sequence[Point], path: Path) -> None:
    """A panel a task, a line and a band an algorithm."""
    figure, axes = plt.subplots(1, len(TASKS), figsize=(13, 3.8), layout="constrained")
    for panel, task in zip(axes, TASKS, strict=True):
        for algorithm, (colour, label) in COLOURS.items():
            scores = defaultdict(list)
            for point in points:
                if (point.task, point.algorithm) == (task, algorithm):
                    scores[point.frames].append(point.score)
            if scores:
                frames = np.array(sorted(scores))
                low, mean, high = ([pick(scores[frame]) for frame in frames] for pick in (min, np.mean, max))
                panel.plot(
                    frames / 1e6, mean, color=colour, label=f"{label}, {max(map(len, scores.values()))} seeds"
                )
                panel.fill_between(frames / 1e6, low, high, color=colour, alpha=0.2, lw=0)
        panel.set(title=task, xlabel="million control steps of the team", ylim=(0, 1))
    axes[0].set_ylabel("validation score, alone")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(COLOURS))
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main(arguments: Sequence[str]) -> int:
    """Read, write, draw; returns 0."""
    parser = make_parser("curves", __doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs"), metavar="DIR")
    points = read_points(parser.parse_args(arguments).runs)
    OUT.mkdir(parents=True, exist_ok=True)
    path = OUT / "curves.csv"
    points = sorted([*points, *_others(path, {(each.task, each.algorithm) for each in points})])
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([Point._fields, *points])
    draw(points, OUT / "curves.png")
    return 0
