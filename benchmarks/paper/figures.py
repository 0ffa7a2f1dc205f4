"""Fig. 6, success over the guidance scale, and Fig. 7, success and control frequency over T."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

from benchmarks.paper.rows import Row
from benchmarks.paper.settings import Guided
from benchmarks.paper.tasks import TASKS

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

STYLES = {
    "CFPG": ("CFPG (terminal)", "#0072b2", "-"),
    "CFPG (eqs. 14, 15)": ("eqs. 14 and 15", "#d55e00", "--"),
    "CFPG (No HGP)": ("no projection", "#009e73", ":"),
}


def draw_scales(rows: Sequence[Row], path: Path) -> None:
    """Multi-objective success over eta, a panel a task, a line a projection."""
    figure, axes = _panels()
    for panel, task in zip(axes, TASKS, strict=True):
        for method, (label, colour, dash) in STYLES.items():
            points = sorted(
                (row.settings.guidance.scale, row.multi_objective_success)
                for row in rows
                if (row.task, row.method, row.euler_steps) == (task, method, None)
                and isinstance(row.settings, Guided)
            )
            if points:
                panel.plot(*zip(*points, strict=True), dash, color=colour, marker="o", ms=4, label=label)
        panel.set(title=task, xscale="log", xlabel="guidance scale eta", ylim=(-3, 103))
    axes[0].set_ylabel("multi-objective success, %")
    axes[0].legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def draw_steps(rows: Sequence[Row], path: Path) -> None:
    """Multi-objective success and control frequency over T, a panel a task."""
    figure, axes = _panels()
    for panel, task in zip(axes, TASKS, strict=True):
        own = sorted(
            (row.euler_steps, row.multi_objective_success, row.control_frequency_hz)
            for row in rows
            if row.task == task and row.euler_steps is not None and row.control_frequency_hz is not None
        )
        if own:
            steps, success, hz = zip(*own, strict=True)
            panel.plot(steps, success, "-o", color="#0072b2", ms=4, label="success")
            other = panel.twinx()
            other.plot(steps, hz, "--s", color="#d55e00", ms=4, label="frequency")
            other.set(yscale="log", ylabel="control frequency on one core, Hz (dashed)")
        panel.set(title=task, xlabel="Euler steps T", ylim=(-3, 103))
    axes[0].set_ylabel("multi-objective success, % (solid)")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _panels() -> tuple[plt.Figure, Sequence[Axes]]:
    return plt.subplots(1, len(TASKS), figsize=(13, 3.8), layout="constrained")
