"""A picture of meetings: one scene from many noise samples, coloured by the side of passing.

The scene is the one in which the unguided flow is most divided; `MeetingRow.two_ways` tells how many are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
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
class Drawn:
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


def draw_meetings(panels: Sequence[Drawn], path: Path) -> None:
    """Draw a panel for each, one above the other: robot 0's tracks solid, robot 1's dotted."""
    size = (7.0, 2.0 * len(panels))
    figure, axes = plt.subplots(
        len(panels), 1, figsize=size, sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for panel, drawn in zip(axes[:, 0], panels, strict=True):
        for side, (colour, label) in COLOURS.items():
            own = drawn.tracks[:, drawn.side == side]
            for robot, dash in enumerate(("-", ":")):
                panel.plot(own[:, :, robot, 0], own[:, :, robot, 1], dash, color=colour, lw=0.6)
            panel.plot([], [], color=colour, label=f"{label} {own.shape[1]}")
        panel.set(title=drawn.title, ylabel="left, m", aspect="equal", ylim=(-0.35, 0.35))
        panel.legend(fontsize=7, loc="upper right")
    axes[-1, 0].set_xlabel("along the way, m")
    figure.suptitle("The scene, of all headings, that divides the unguided flow most", fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
