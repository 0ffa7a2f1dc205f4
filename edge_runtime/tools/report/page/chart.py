"""The drawings that pages share: lines over time against limits, histograms, bars, timelines.

Each function takes plain numbers and returns SVG. Times are in seconds; whoever calls names other units.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.tools.report.page.theme import (
    BAD,
    LIMIT,
    PAPER,
    colour,
    drawing,
    legend,
    line_style,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_POINTS: Final = 500
"""A longer line is drawn by the extremes of so many stretches: no peak is lost."""


class Limit(msgspec.Struct, frozen=True):
    """A line that values should not cross while it holds."""

    value: float
    name: str
    """Written at its beginning; empty for one that goes on from another stretch."""
    begin_s: float = -math.inf
    end_s: float = math.inf


class Span(msgspec.Struct, frozen=True):
    """A stretch of time on a row of a timeline."""

    row: str
    start_s: float
    end_s: float
    name: str


@drawing
def over_time(
    series: Mapping[str, tuple[Floats, Floats]],
    label: str,
    limits: Sequence[Limit] = (),
    *,
    from_zero: bool = True,
    steps: bool = False,
) -> "Figure":
    """Draw one line for each name: times (T,) and values (T,)."""
    figure = new_figure(2.6)
    axes = figure.subplots()
    for index, (name, (time_s, values)) in enumerate(series.items()):
        axes.plot(
            *thinned(time_s, values),
            drawstyle="steps-post" if steps else "default",
            **line_style(index, name),
        )
    last_s = max((float(time_s[-1]) for time_s, _ in series.values() if len(time_s)), default=1.0)
    for limit in limits:
        begin_s, end_s = max(limit.begin_s, 0.0), min(limit.end_s, last_s)
        axes.hlines(limit.value, begin_s, end_s, color=LIMIT, linestyle=(0, (6, 3)), linewidth=1.2)
        axes.annotate(
            limit.name, (begin_s, limit.value), xytext=(4, 3),
            textcoords="offset points", ha="left", va="bottom", color=LIMIT, fontsize=9,
        )  # fmt: skip
    axes.margins(y=0.1)
    axes.set_xlim(0.0, last_s)
    if from_zero:
        low, high = axes.get_ylim()
        axes.set_ylim(0.0 if low >= 0.0 or _never_negative(series) else low, max(high, 1e-9))
    axes.set_xlabel("time in s")
    axes.set_ylabel(label)
    legend(figure, len(series))
    return figure


@drawing
def histograms(values: Mapping[str, Floats], label: str) -> "Figure":
    """Draw one row for each name, over one logarithmic axis of positive values."""
    figure = new_figure(0.55 * len(values) + 0.7)
    rows = np.atleast_1d(figure.subplots(len(values), sharex=True))
    every = np.concatenate([row[row > 0.0] for row in values.values()] or [np.ones(1)])
    low, high = (every.min(), every.max()) if len(every) else (1.0, 10.0)
    edges = np.geomspace(low * 0.9, max(high * 1.1, low * 2.0), 60)
    for index, (axes, (name, row)) in enumerate(zip(rows, values.items(), strict=True)):
        counts, _ = np.histogram(row, edges)
        axes.stairs(counts / max(1, counts.max()), edges, fill=True, color=colour(index))
        axes.set(xscale="log", yticks=[], ylim=(0, 1.1))
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_visible(False)
        axes.set_ylabel(name, rotation=0, ha="right", va="center")
    rows[-1].set_xlabel(label)
    return figure


@drawing
def bars(values: Mapping[str, Mapping[str, float]], label: str) -> "Figure":
    """Draw a group of bars for each outer name, one bar for each inner name."""
    groups = list(values)
    names = list(dict.fromkeys(name for group in values.values() for name in group))
    figure = new_figure(0.45 + max(1.2, 0.22 * len(groups) * (len(names) + 1)))
    axes = figure.subplots()
    height = 0.8 / max(1, len(names))
    for index, name in enumerate(names):
        places = np.arange(len(groups)) + height * (index - 0.5 * (len(names) - 1))
        lengths = [values[group].get(name, 0.0) for group in groups]
        axes.barh(places, lengths, 0.9 * height, label=name, color=colour(index))
    axes.set_yticks(range(len(groups)), groups)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(label)
    axes.set_xlim(0.0, max(1e-9, axes.get_xlim()[1]))
    legend(figure, len(names))
    return figure


@drawing
def timeline(
    rows: Sequence[str], spans: Sequence[Span], marks: Sequence[tuple[str, float, str]], end_s: float
) -> "Figure":
    """Draw stretches and marks (row, time, name) on one row for each robot."""
    figure = new_figure(0.9 + 0.34 * len(rows))
    axes = figure.subplots()
    places = {row: index for index, row in enumerate(rows)}
    for span in spans:
        length = max(span.end_s - span.start_s, 0.002 * end_s)
        axes.barh(places[span.row], length, 0.55, span.start_s, color=BAD, label=span.name)
    kinds = list(dict.fromkeys(name for _, _, name in marks))
    for index, kind in enumerate(kinds):
        chosen = [(time_s, places[row]) for row, time_s, name in marks if name == kind]
        axes.plot(*np.array(chosen).T, "ovsD^P*X"[index % 8], markersize=5, color=colour(index),
                  label=kind, markeredgecolor=PAPER, markeredgewidth=0.5)  # fmt: skip
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(0.0, max(end_s, 1e-9))
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("time in s")
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if named:
        figure.legend(named.values(), named.keys(), loc="outside upper left", ncols=min(4, len(named)))
    return figure


def thinned(time_s: Floats, values: Floats) -> tuple[Floats, ...]:
    """Return a long line by fewer points: times, then each component of values (T,) or (T, D).

    A single component keeps the extremes of every stretch, so that no peak is lost.
    """
    count = len(time_s)
    if count <= 2 * MOST_POINTS:
        kept = np.arange(count)
    elif values.ndim == 1:
        stretches = np.array_split(np.arange(count), MOST_POINTS)
        kept = np.unique(
            [
                _extreme(values, stretch, pick)
                for stretch in stretches
                for pick in (np.nanargmin, np.nanargmax)
            ]
        )
    else:
        kept = np.linspace(0, count - 1, 2 * MOST_POINTS).astype(int)
    components = values[:, None] if values.ndim == 1 else values
    return time_s[kept], *components[kept].T


def _extreme(values: Floats, stretch: npt.NDArray[np.int64], pick: Callable[[Floats], np.intp]) -> int:
    part = values[stretch]
    return int(stretch[0 if np.isnan(part).all() else pick(part)])


def _never_negative(series: Mapping[str, tuple[Floats, Floats]]) -> bool:
    return all(not (values < 0.0).any() for _, values in series.values())
