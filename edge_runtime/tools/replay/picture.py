"""The picture of what a robot did and what it would have done instead; needs matplotlib."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from edge_runtime.messages import Command
from edge_runtime.recording.schema import RobotPlace
from edge_runtime.tools.replay.question import Answer, speeds_m_s

DONE, INSTEAD = "tab:blue", "tab:orange"
ARROWS = 24
"""So many situations show both actions."""
LONGEST: Final = 0.2
"""Of the arrows, as a share of the way's extent."""


def draw(answer: Answer, question: str, path: Path) -> None:
    """Write the picture: the way with what both actions do, both commanded speeds, the actions' distance."""
    mpl.rcParams["text.parse_math"] = False  # names are no formulas
    figure, panels = plt.subplot_mosaic(
        [["way", "speed"], ["way", "change"]], figsize=(10, 5), layout="constrained"
    )
    robot_id = answer.start.robot_id
    figure.suptitle(f"Robot {robot_id}: as it was, and with {question}")
    place = next(robot for robot in answer.start.fleet.robots if robot.robot_id == robot_id)
    _draw_way(panels["way"], answer, place)
    for commands, colour, label in ((answer.done, DONE, "as it was"), (answer.instead, INSTEAD, "instead")):
        panels["speed"].plot(answer.times_s, speeds_m_s(commands), color=colour, lw=1.2, label=label)
    panels["speed"].set(ylabel="commanded speed in m/s", ylim=(0.0, None))
    panels["speed"].legend()
    panels["change"].plot(answer.times_s, answer.changes(), color="black", lw=1.0)
    panels["change"].set(xlabel="time in s", ylabel="distance between the actions", ylim=(0.0, None))
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _velocities(commands: Iterable[Command]) -> np.ndarray:
    """Commanded velocities (T, 2) in the plane."""
    return np.array([command.velocity_m_s[:2] for command in commands])


def _draw_way(axes: Axes, answer: Answer, place: RobotPlace) -> None:
    way = np.array(answer.positions_m)[:, :2]  # from above
    axes.plot(*way.T, color="lightgrey", lw=3, zorder=1)
    axes.plot(*place.start_m[:2], "o", color="grey", label="start")
    if place.goal_m:
        axes.plot(*place.goal_m[:2], "*", color="black", ms=12, label="goal")
    shown = np.unique(np.linspace(0, len(way) - 1, ARROWS).astype(int))
    before = np.array(answer.velocities_m_s)[:, :2]
    pushes = [_velocities(commands) - before for commands in (answer.done, answer.instead)]
    every = np.concatenate(pushes)
    scale = np.abs(every).max() / (LONGEST * max(np.ptp(way), 1e-3)) or 1.0
    for push, colour, label in zip(pushes, (DONE, INSTEAD), ("as it was", "instead"), strict=True):
        axes.quiver(
            *way[shown].T,
            *push[shown].T,
            color=colour,
            label=f"change of velocity, {label}",
            angles="xy",
            scale_units="xy",
            scale=scale,
            width=0.005,
            zorder=2,
        )
    axes.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    axes.margins(0.15)
    axes.legend(fontsize="small")
