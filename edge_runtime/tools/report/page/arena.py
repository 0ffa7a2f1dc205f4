"""Maps: where robots went, their goals, fences, to scale."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.messages import Place, Vector2
from edge_runtime.tools.report.page.chart import thinned
from edge_runtime.tools.report.page.theme import (
    LIMIT,
    WIDTH_IN,
    colour,
    drawing,
    legend,
    line_style,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch


class Circle(msgspec.Struct, frozen=True):
    """A place that has a name, such as a fence."""

    centre_m: Vector2
    radius_m: float
    name: str


class Track(msgspec.Struct, frozen=True):
    """Where one robot or tracked object went."""

    name: str
    position_m: Floats
    """(T, 2); NaN where it was not seen."""
    goal_m: Place | None
    radius_m: float


@drawing
def arena(tracks: Sequence[Track], circles: Sequence[Circle] = (), goal_tolerance_m: float = 0.0) -> "Figure":
    """Draw each robot's way from a dot to its disc, goals as crosses, circles by name."""
    figure = new_figure(0.95 * WIDTH_IN)
    axes = figure.subplots()
    draw_places(axes, tracks, circles, goal_tolerance_m)
    for index, track in enumerate(tracks):
        seen = track.position_m[np.isfinite(track.position_m).all(-1)]
        if not len(seen):
            continue
        axes.plot(*thinned(np.arange(len(seen), dtype=np.float64), seen)[1:], **line_style(index, track.name))
        axes.plot(*seen[0], "o", markersize=3.5, color=colour(index))
        axes.add_patch(disc(seen[-1], track.radius_m, facecolor=colour(index), alpha=0.35))
    legend(figure, len(tracks))
    return figure


def draw_places(
    axes: "Axes", tracks: Sequence[Track], circles: Sequence[Circle], goal_tolerance_m: float
) -> None:
    """Draw what stands still, with axes to scale."""
    for index, track in enumerate(tracks):
        if track.goal_m is None:
            continue
        axes.plot(*track.goal_m[:2], "x", color=colour(index), markersize=6, markeredgewidth=1.6)
        if goal_tolerance_m:
            axes.add_patch(disc(track.goal_m[:2], goal_tolerance_m, fill=False, edgecolor=colour(index)))
    for circle in circles:
        axes.add_patch(disc(circle.centre_m, circle.radius_m, fill=False, edgecolor=LIMIT, linestyle="--"))
        x, y = circle.centre_m
        axes.annotate(
            circle.name, (x, y + circle.radius_m), color=LIMIT, ha="center", va="bottom", fontsize=9
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m")


def disc(centre_m: Any, radius_m: float, **style: Any) -> "Patch":  # noqa: ANN401  # a pair; matplotlib's own
    """Return a circle to add to axes."""
    from matplotlib.patches import Circle as Disc  # noqa: PLC0415  # an extra

    return Disc((centre_m[0], centre_m[1]), radius_m, linewidth=1.0, **style)
