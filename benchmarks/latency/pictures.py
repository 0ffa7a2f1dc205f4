"""One picture of each sweep and one of the paced loops."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

from benchmarks.latency.growth import Growth
from benchmarks.latency.rows import LatencyRow

mpl.use("Agg")
import matplotlib.pyplot as plt


def draw_sweep(growths: Sequence[Growth], path: Path) -> None:
    """Tick over the sweep's values, one line for each backend."""
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for growth in growths:
        axes.plot(growth.sweep.values, growth.microseconds, marker="o", label=growth.backend)
    axes.set(xlabel=growths[0].sweep.title, ylabel="one tick, best round (µs)", yscale="log")
    if growths[0].sweep.values[-1] > 16:
        axes.set_xscale("symlog", base=2, linthresh=1)
        axes.set_xticks(growths[0].sweep.values, [str(value) for value in growths[0].sweep.values])
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def draw_paced(rows: Sequence[LatencyRow], path: Path) -> None:
    """Median and 99.9th percentile of the paced loops."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    places = range(len(rows))
    axes.bar(places, [row.p99_9_us for row in rows], color="0.8", label="99.9 %")
    axes.bar(places, [row.median_us for row in rows], color="tab:blue", label="median")
    axes.set_xticks(places, [row.loop for row in rows], fontsize=6, rotation=90)
    axes.set(ylabel="one tick in a sleeping loop (µs)", yscale="log")
    axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)
