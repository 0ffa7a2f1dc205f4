"""The moving pictures of the README: the same episode of a task, left alone and guided, side by side.

The packaged policies drive. The episode is the first that the tuned default satisfies, until it has.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.common.flags import make_parser
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tracks import SETTING, Track, follow
from benchmarks.paper.tuning import tuned_default
from edge_runtime.common.arrays import Floats
from edge_runtime.errors import ConfigError
from edge_runtime.objectives import Geofence, Objective, SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.policy.manifest import Manifest
from edge_runtime.tools.report.page.animation import Load, Scene, animate, check_target
from edge_runtime.tools.report.page.arena import Circle
from export.episodes.neighbourhood import Setting
from export.scenarios.balance_starts import LINE_LENGTH_M, PACKAGE_RADIUS_M

FOLDER = Path(__file__).parents[1] / "docs" / "pictures"
LONGEST_S = {"navigation": 12.0, "balance": 30.0, "sampling": 15.0}
"""Shown of each task."""


def main(arguments: Sequence[str]) -> int:
    """Draw the pictures that are asked for."""
    parser = make_parser("pictures", __doc__)
    names = ", ".join(LONGEST_S)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"any of {names} (default: all)")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help="where the pictures go")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.tasks if name not in LONGEST_S]:
        raise ConfigError(f"unknown task {unknown[0]!r}: choose from {names}")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.tasks or LONGEST_S:
        path = options.out / f"{name}.gif"
        check_target(path)
        draw(name, path)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


def draw(name: str, path: Path, setting: Setting = SETTING) -> None:
    """Draw one task."""
    bundle, task = packaged_bundle(name), TASKS[name]
    longest = round(LONGEST_S[name] / bundle.manifest.motion.dt_s)
    tracks = follow(task, tuned_default(name), bundle, setting, longest)
    titles = ("without guidance", "with guidance")
    scenes = [
        _scene(title, track, bundle.manifest, task.objectives)
        for title, track in zip(titles, tracks, strict=True)
    ]
    animate(scenes, path)


def _scene(title: str, track: Track, manifest: Manifest, asked: Sequence[Objective]) -> Scene:
    goal, load = track.state("goal"), _load(track)
    return Scene(
        title=title,
        period_s=manifest.motion.dt_s,
        position_m=track.position,
        velocity_m_s=track.velocity,
        goals_m=[] if goal is None or load else goal[0].tolist(),
        radius_m=manifest.body.radius_m,
        speed_limit_m_s=min((each.limit_m_s for each in asked if isinstance(each, SpeedLimit)), default=None),
        margin_m=max((each.distance_m for each in asked if isinstance(each, SafetyMargin)), default=None),
        load=load,
        circles=[
            Circle(each.centre_m, each.radius_m, each.name) for each in asked if isinstance(each, Geofence)
        ],
    )


def _load(track: Track) -> Load | None:
    """What Balance's robots carry, and where to; None elsewhere."""
    package, goal, line, angle = (track.state(name) for name in ("package", "goal", "line", "line_angle"))
    if package is None or goal is None or line is None or angle is None:
        return None
    x, y = goal[0].tolist()
    return Load(package, PACKAGE_RADIUS_M, _beam_ends(line, angle), (x, y))


def _beam_ends(centre: Floats, angle: Floats) -> Floats:
    """Both ends (S, 2, 2) of beams with centres (S, 2) and inclinations (S, 1)."""
    half = 0.5 * LINE_LENGTH_M * np.concatenate([np.cos(angle), np.sin(angle)], -1)
    return np.stack([centre - half, centre + half], 1)
