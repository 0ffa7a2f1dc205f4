"""Fig. 3: one episode of a task, left alone and guided."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.paper.contestants import Contestant
from benchmarks.paper.episodes import MakeDecide, Setting, run_episodes
from benchmarks.paper.judges import Flags, motion
from benchmarks.paper.methods import unguided
from benchmarks.paper.policies import load_policy
from benchmarks.paper.tasks import Task
from edge_runtime.common.arrays import Floats
from export.scenarios.definitions import SAMPLING
from export.scenarios.scenario import Scenario

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

SETTING = Setting(episodes=10, seed=3)
COLOURS = ("#d62728", "#ff7f0e", "#bcbd22", "#2ca02c", "#1f77b4")


def draw_trajectories(task: Task, who: Contestant, policies: Path, path: Path, *, quick: bool) -> None:
    """Draw the first episode that guidance satisfies (the first of all, if none), and the same unguided.

    Both until guidance has satisfied everything: what robots do afterwards, no objective asks for.
    """
    bundle = load_policy(policies, task.name, who.algorithm, seed=0)
    guided_tracks, satisfied, lengths = _follow(task, who.make(bundle), quick=quick)
    free_tracks, _, _ = _follow(task, unguided(bundle, 1.0), quick=quick)
    episode = int(np.argmax(satisfied))
    shown = lengths[episode]
    figure, axes = plt.subplots(1, 2, figsize=(10, 5), sharex=True, sharey=True, layout="constrained")
    for panel, tracks, title in zip(axes, (free_tracks, guided_tracks), ("unguided", "guided"), strict=True):
        _draw(panel, task, tracks[:shown, episode])
        panel.set(title=f"{task.name}, {title}", xlabel="x, m", aspect="equal")
    axes[0].set_ylabel("y, m")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _follow(task: Task, make: MakeDecide, *, quick: bool) -> tuple[Floats, np.ndarray, np.ndarray]:
    """Positions (steps, E, N, 2) of some episodes, which were satisfied, and how many steps each took."""
    seen: list[Floats] = []
    ran: list[Flags] = []

    def watch(world: Scenario, running: Flags) -> None:
        seen.append(motion(world)[0])
        ran.append(running.copy())

    setting = Setting(2, SETTING.seed) if quick else SETTING
    outcome = run_episodes(task, make, setting, watch=watch)
    return np.stack(seen), outcome.satisfied, np.sum(ran, 0) + 1


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
