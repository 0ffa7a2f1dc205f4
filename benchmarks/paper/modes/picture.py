"""A picture of meetings: one scene from many noise samples, coloured by the side of passing.

The scene is the one in which the first policy is most divided; `MeetingRow.two_ways` tells how many are.
"""

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.paper.modes.meetings import sides
from edge_runtime.common.arrays import Floats

mpl.use("Agg")
from matplotlib import pyplot as plt

COLOURS = {1: ("#0072b2", "left"), -1: ("#d55e00", "right"), 0: ("#777777", "stand-off")}
"""By `sides`."""


def draw_meetings(tracks: Mapping[str, Floats], scenes: int, path: Path) -> None:
    """Draw a panel for each policy's meetings along x (S, E, N, 2), E / ``scenes`` in a row of each scene."""
    by_scene = sides(next(iter(tracks.values()))).reshape(scenes, -1)
    scene = int(np.minimum((by_scene == 1).sum(1), (by_scene == -1).sum(1)).argmax())
    shown = slice(scene * by_scene.shape[1], (scene + 1) * by_scene.shape[1])
    size = (7.0, 2.0 * len(tracks))
    figure, axes = plt.subplots(
        len(tracks), 1, figsize=size, sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for panel, (title, track) in zip(axes[:, 0], tracks.items(), strict=True):
        for side, (colour, label) in COLOURS.items():
            own = track[:, shown][:, sides(track[:, shown]) == side]
            for robot, dash in enumerate(("-", ":")):
                panel.plot(own[:, :, robot, 0], own[:, :, robot, 1], dash, color=colour, lw=0.6)
            panel.plot([], [], color=colour, label=f"{label} {own.shape[1]}")
        panel.set(title=title, ylabel="left, m", aspect="equal", ylim=(-0.35, 0.35))
        panel.legend(fontsize=7, loc="upper right")
    axes[-1, 0].set_xlabel("along the way, m")
    figure.suptitle("The scene, of all headings, that divides the unguided flow most", fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
