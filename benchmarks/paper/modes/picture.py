"""A picture of meetings: one scene from many noise samples, coloured by the side of passing.

The scene is the one in which the first policy is most divided; `MeetingRow.two_ways` tells how many are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats

mpl.use("Agg")
from matplotlib import pyplot as plt

COLOURS = {1: ("#0072b2", "left"), -1: ("#d55e00", "right"), 0: ("#777777", "stand-off")}
"""By `Meetings.side`."""


@dataclass(frozen=True)
class Panel:
    """One panel."""

    title: str
    tracks: Floats
    """(steps, E, 2, 2): both robots' positions in E meetings of one scene."""
    side: npt.NDArray[np.int64]
    """(E,)"""


def along(tracks: Floats, angle_rad: Floats) -> Floats:
    """Turn tracks (steps, E, R, 2) so that headings (E,) point along x."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned: Floats = np.einsum("ije,serj->seri", np.array([[cos, sin], [-sin, cos]]), tracks)
    return turned


def most_divided(panels: Sequence[Panel], scenes: int) -> list[Panel]:
    """Leave of every policy's S scenes the one in which the first policy is most divided."""
    side = panels[0].side.reshape(scenes, -1)
    scene = int(np.minimum((side == 1).sum(1), (side == -1).sum(1)).argmax())
    own = slice(scene * side.shape[1], (scene + 1) * side.shape[1])
    return [replace(panel, tracks=panel.tracks[:, own], side=panel.side[own]) for panel in panels]


def draw_meetings(panels: Sequence[Panel], path: Path) -> None:
    """Draw a panel for each, one above the other: robot 0's tracks solid, robot 1's dotted."""
    size = (7.0, 2.0 * len(panels))
    figure, axes = plt.subplots(
        len(panels), 1, figsize=size, sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for axis, panel in zip(axes[:, 0], panels, strict=True):
        for side, (colour, label) in COLOURS.items():
            own = panel.tracks[:, panel.side == side]
            for robot, dash in enumerate(("-", ":")):
                axis.plot(own[:, :, robot, 0], own[:, :, robot, 1], dash, color=colour, lw=0.6)
            axis.plot([], [], color=colour, label=f"{label} {own.shape[1]}")
        axis.set(title=panel.title, ylabel="left, m", aspect="equal", ylim=(-0.35, 0.35))
        axis.legend(fontsize=7, loc="upper right")
    axes[-1, 0].set_xlabel("along the way, m")
    figure.suptitle("The scene, of all headings, that divides the unguided flow most", fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
