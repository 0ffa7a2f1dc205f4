"""The moving pictures of the README: the same episode of a task, left alone and guided, side by side.

One row of `PICTURES` a task. The episode is the first one that the tuned default satisfies, shown until
it has.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.paper.episodes import MakeDecide, Setting, run_episodes
from benchmarks.paper.judges import Flags, motion
from benchmarks.paper.methods import unguided
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import chosen, read_tuned
from edge_runtime.common.arrays import Floats
from edge_runtime.errors import ConfigError
from edge_runtime.objectives import Geofence, SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import Bundle, packaged_bundle
from edge_runtime.tools.report.page.animation import Load, Scene, animate, check_target
from edge_runtime.tools.report.page.arena import Circle
from export.scenarios.balance_starts import LINE_LENGTH_M, PACKAGE_RADIUS_M
from export.scenarios.scenario import Scenario

FOLDER = Path(__file__).parents[1] / "docs" / "pictures"
SETTING = Setting(episodes=10, seed=3)


class Picture(msgspec.Struct, frozen=True):
    """How one task is shown."""

    task: str
    """Driven by the packaged policy of its name."""
    seconds: float
    """Longest time shown."""


PICTURES = {
    picture.task: picture
    for picture in (
        Picture("navigation", 12.0),
        Picture("balance", 30.0),
        Picture("sampling", 15.0),
    )
}


def main(arguments: Sequence[str]) -> int:
    """Draw the pictures that are asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks pictures", description=__doc__)
    parser.add_argument("tasks", nargs="*", metavar="TASK",
                        help=f"any of {', '.join(PICTURES)} (default: all)")  # fmt: skip
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help="where the pictures go")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.tasks if name not in PICTURES]:
        raise ConfigError(f"unknown task {unknown[0]!r}: choose from {', '.join(PICTURES)}")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.tasks or PICTURES:
        path = options.out / f"{name}.gif"
        check_target(path)
        draw(PICTURES[name], path)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


def draw(picture: Picture, path: Path, setting: Setting = SETTING) -> None:
    """Draw one task."""
    bundle = packaged_bundle(picture.task)
    task = TASKS[picture.task]
    who = chosen(read_tuned(), task, "CFPG")
    with_guidance, alone = who.make(bundle), unguided(bundle, start_noise=1.0)
    satisfied, after = _follow(picture, with_guidance, setting)
    _, before = _follow(picture, alone, setting)
    lengths = 1 + np.sum(after.running, 0)
    episode = int(np.argmax(satisfied))
    shown = min(round(picture.seconds / bundle.manifest.dynamics.dt_s), int(lengths[episode]))
    scenes = [
        _scene(picture, bundle, title, tracks, episode, shown)
        for title, tracks in (("without guidance", before), ("with guidance", after))
    ]
    animate(scenes, path)


class _Tracks:
    """What is seen of every episode before each of its steps."""

    def __init__(self) -> None:
        self.position: list[Floats] = []
        self.velocity: list[Floats] = []
        self.goals: Floats | None = None
        self.package: list[Floats] = []
        self.beam: list[Floats] = []
        self.running: list[Flags] = []

    def watch(self, world: Scenario, running: Flags) -> None:
        """Note where everybody is, and what they carry."""
        position, velocity = motion(world)
        state = world.state_dict()
        if not self.position and "goal" in state:
            self.goals = state["goal"].double().numpy().copy()
        if "line" in state:
            self.package.append(state["package"].double().numpy())
            self.beam.append(_beam_ends(state["line"].double().numpy(), state["line_angle"].double().numpy()))
        self.position.append(position.copy())
        self.velocity.append(velocity.copy())
        self.running.append(running.copy())


def _beam_ends(centre: Floats, angle: Floats) -> Floats:
    """Both ends (E, 2, 2) of beams with centres (E, 2) and inclinations (E, 1)."""
    half = 0.5 * LINE_LENGTH_M * np.concatenate([np.cos(angle), np.sin(angle)], -1)
    return np.stack([centre - half, centre + half], 1)


def _load(tracks: _Tracks, shown: int, episode: int) -> Load | None:
    if tracks.goals is None or not tracks.beam:
        return None
    package, beam = (np.stack(each)[:shown, episode] for each in (tracks.package, tracks.beam))
    x, y = tracks.goals[episode].tolist()
    return Load(package, PACKAGE_RADIUS_M, beam, (x, y))


def _follow(picture: Picture, make: MakeDecide, setting: Setting) -> tuple[np.ndarray, _Tracks]:
    tracks = _Tracks()
    outcome = run_episodes(TASKS[picture.task], make, setting, watch=tracks.watch)
    return outcome.satisfied, tracks


def _scene(picture: Picture, bundle: Bundle, title: str, tracks: _Tracks, episode: int, shown: int) -> Scene:
    manifest = bundle.manifest
    position = np.stack(tracks.position)[:shown, episode]
    goals = [] if tracks.goals is None or tracks.goals.ndim != 3 else tracks.goals[episode].tolist()
    asked = TASKS[picture.task].objectives
    return Scene(
        title=title,
        period_s=manifest.dynamics.dt_s,
        position_m=position,
        velocity_m_s=np.stack(tracks.velocity)[:shown, episode],
        goals_m=goals,
        radius_m=manifest.body.radius_m,
        speed_limit_m_s=min((each.limit_m_s for each in asked if isinstance(each, SpeedLimit)), default=None),
        margin_m=max((each.distance_m for each in asked if isinstance(each, SafetyMargin)), default=None),
        load=_load(tracks, shown, episode),
        circles=[
            Circle(each.centre_m, each.radius_m, each.name) for each in asked if isinstance(each, Geofence)
        ],
    )
