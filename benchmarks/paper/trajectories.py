"""Fig. 3: one episode of a task, left alone and guided."""

from pathlib import Path

import matplotlib as mpl

from benchmarks.paper.policies import find_policy
from benchmarks.paper.settings import Guided
from benchmarks.paper.tasks import Task
from benchmarks.paper.tracks import SETTING, follow
from edge_runtime.common.arrays import Floats
from edge_runtime.policy.bundle import load_bundle
from export.episodes.neighbourhood import Setting
from export.scenarios.definitions import SAMPLING

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

COLOURS = ("#d62728", "#ff7f0e", "#bcbd22", "#2ca02c", "#1f77b4")
QUICK = Setting(episodes=2, episodes_seed=SETTING.episodes_seed)


def draw_trajectories(task: Task, settings: Guided, policies: Path, path: Path, *, quick: bool) -> None:
    """Draw the two tracks side by side."""
    bundle = load_bundle(find_policy(policies, task.name, settings.algorithm(task.name), seed=0))
    tracks = follow(task, settings, bundle, QUICK if quick else SETTING)
    figure, axes = plt.subplots(1, 2, figsize=(10, 5), sharex=True, sharey=True, layout="constrained")
    for panel, track, title in zip(axes, tracks, ("unguided", "guided"), strict=True):
        _draw(panel, task, track.position)
        panel.set(title=f"{task.name}, {title}", xlabel="x, m", aspect="equal")
    axes[0].set_ylabel("y, m")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _draw(panel: Axes, task: Task, tracks: Floats) -> None:
    if task.name == "sampling":
        panel.add_patch(plt.Circle(SAMPLING.geofence.centre_m, SAMPLING.geofence.radius_m, color="#f4b6b6"))
    for robot in range(tracks.shape[1]):
        track, colour = tracks[:, robot], COLOURS[robot]
        panel.plot(*track.T, color=colour, lw=1)
        panel.scatter(*track[::10].T, color=colour, s=6, alpha=0.6)
        panel.scatter(*track[0], facecolors="none", edgecolors=colour, s=60)
        panel.scatter(*track[-1], color=colour, s=60, label=f"robot {robot}")
    panel.legend(fontsize=7, loc="best")
