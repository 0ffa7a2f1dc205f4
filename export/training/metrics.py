"""The table of a training run: one row per update, and its picture."""

import csv
import io
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from msgspec import Struct
from msgspec.structs import asdict

from edge_runtime.common.bounds import Finite
from export.training.run_file import write_run_file

mpl.use("Agg")


class MetricsRow(Struct, frozen=True, forbid_unknown_fields=True):
    """One update; None where no episode ended, or where no validation was due."""

    frames: int
    seconds: Finite
    """Wall-clock time of training so far, over all its resumed parts."""
    ratio_change: Finite
    value_loss: Finite
    learning_rate: Finite
    mean_return: Finite | None
    success: Finite | None
    failure: Finite | None
    validation_return: Finite | None = None
    validation_success: Finite | None = None
    validation_failure: Finite | None = None
    guided_success: Finite | None = None
    """Of a validation's guided episodes: the share that satisfied task and execution objectives at once."""
    score: Finite | None = None


def write_table(path: Path, rows: list[MetricsRow]) -> None:
    """Write ``metrics.csv``, atomically.

    Raises:
        ConfigError: if the file cannot be written.
    """
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, MetricsRow.__struct_fields__)
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    write_run_file(path, buffer.getvalue().encode())


def draw_curve(path: Path, rows: list[MetricsRow], title: str, failure: str) -> None:
    """Draw returns, successes and failures over frames into a PNG file, atomically.

    Raises:
        ConfigError: if the file cannot be written.
    """
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    figure.suptitle(title)
    _plot(left, rows, "mean_return", "training", "-")
    _plot(left, rows, "validation_return", "validation", "o-")
    left.set(xlabel="team frames", ylabel="return of an episode")
    _plot(right, rows, "guided_success", "task and objectives, guided", "s-")
    _plot(right, rows, "validation_success", "success, validation", "o-")
    _plot(right, rows, "success", "success, training", "-")
    _plot(right, rows, "failure", f"{failure}, training", "-")
    right.set(xlabel="team frames", ylabel="share of episodes", ylim=(-0.02, 1.02))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    write_run_file(path, buffer.getvalue())


def _plot(axes: "mpl.axes.Axes", rows: list[MetricsRow], column: str, label: str, style: str) -> None:
    points = [(row.frames, getattr(row, column)) for row in rows if getattr(row, column) is not None]
    if points:
        axes.plot(*zip(*points, strict=True), style, markersize=3, label=label)
