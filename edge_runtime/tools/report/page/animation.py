"""Moving pictures of a team: discs coloured by speed, trails, margins and goals; scenes side by side."""

import math
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.common.command_line import check_writable, need
from edge_runtime.common.printable import first_line
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Vector2
from edge_runtime.tools.report.page.arena import Circle, disc
from edge_runtime.tools.report.page.progress import steps
from edge_runtime.tools.report.page.theme import SERIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_FRAMES: Final = 120
FRAMES_PER_S: Final = 12
PANEL_IN: Final = 3.4
DPI: Final = 90
TRAIL_S: Final = 3.0
OVER: Final = "#d55e00"
"""What breaks a limit: vermilion, beside colours of speed that run from blue to yellow."""
COLOURS: Final = 64
"""Of a GIF; the fewer, the smaller the file."""


@dataclass(frozen=True)
class Load:
    """What a team carries: a package on a beam, to be brought to a place."""

    package_m: Floats
    """(T, 2)"""
    radius_m: float
    beam_m: Floats
    """(T, 2, 2): both ends."""
    target_m: Vector2


@dataclass(frozen=True)
class Moving:
    """A tracked object."""

    position_m: Floats
    """(T, 2); NaN where it was not seen."""
    radius_m: float
    goal_m: Vector2 | None


@dataclass(frozen=True)
class Scene:
    """One team over T equal periods."""

    title: str
    period_s: float
    position_m: Floats
    """(T, N, 2); NaN where a robot was not seen."""
    velocity_m_s: Floats
    """(T, N, dims)"""
    goals_m: Sequence[Vector2 | None]
    """One for each robot, where it has one; or none at all."""
    radius_m: float
    speed_limit_m_s: float | None = None
    margin_m: float | None = None
    circles: Sequence[Circle] = ()
    load: Load | None = None
    objects: Sequence[Moving] = ()
    height_m: Floats | None = None
    """(T, N) of robots in space, which are seen from above."""


def check_target(path: Path) -> None:
    """Find out before the work starts whether a picture can be made.

    Raises:
        ConfigError: if matplotlib is missing, the format is unknown or needs ffmpeg, or the path cannot be
            written.
    """
    need("matplotlib", "report")
    if path.suffix not in (".gif", ".mp4"):
        raise ConfigError(f"{path}: a moving picture's name ends in .gif or .mp4")
    if path.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ConfigError(f"{path}: needs ffmpeg, which is not installed; write a .gif instead")
    check_writable(path)


def animate(scenes: Sequence[Scene], path: Path) -> None:
    """Draw scenes side by side; they start together, and each stays as it ended until the longest is over.

    Raises:
        ConfigError: if the system does not take the file.
    """
    import matplotlib as mpl  # noqa: PLC0415  # an extra

    try:
        with mpl.rc_context({"text.parse_math": False}):
            _animate(scenes, path)
    except (OSError, subprocess.CalledProcessError) as error:
        reason = getattr(error, "strerror", None) or first_line(error)
        raise ConfigError(f"{path}: cannot be written ({reason})") from error


def _animate(scenes: Sequence[Scene], path: Path) -> None:
    from matplotlib.animation import FFMpegWriter  # noqa: PLC0415
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(PANEL_IN * len(scenes), PANEL_IN + 0.35), dpi=DPI, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    panels = [
        _Panel(axes, scene)
        for axes, scene in zip(np.ravel(figure.subplots(1, len(scenes))), scenes, strict=True)
    ]
    _frame(panels, scenes)
    _draw(panels, 0.0)
    canvas.draw()  # type: ignore[no-untyped-call]
    figure.set_layout_engine("none")  # the first frame's serves all
    end_s = max(len(scene.position_m) * scene.period_s for scene in scenes)
    count = min(MOST_FRAMES, max(2, math.ceil(end_s * FRAMES_PER_S)))
    times = np.linspace(0.0, end_s, count)
    hold = FRAMES_PER_S  # the end stays for a second
    if path.suffix == ".mp4":
        writer = FFMpegWriter(fps=FRAMES_PER_S)
        with writer.saving(figure, str(path), DPI):
            for time_s in steps([*times, *[end_s] * hold], "drawing"):
                _draw(panels, time_s)
                writer.grab_frame()
        return
    frames = []
    for time_s in steps(list(times), "drawing"):
        _draw(panels, time_s)
        canvas.draw()  # type: ignore[no-untyped-call]
        frames.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())  # type: ignore[no-untyped-call]
    _write_gif(frames, path, 1000 * hold // FRAMES_PER_S)


def _write_gif(frames: list[Any], path: Path, hold_ms: int) -> None:
    """Write frames that share one palette, so that only what moves differs from one to the next."""
    from PIL import Image  # noqa: PLC0415  # comes with matplotlib

    sample = Image.fromarray(np.concatenate([frames[0], frames[len(frames) // 2], frames[-1]]))
    palette = sample.quantize(COLOURS, dither=Image.Dither.NONE)
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    lengths = [1000 // FRAMES_PER_S] * (len(images) - 1) + [hold_ms]
    images[0].save(path, save_all=True, append_images=images[1:], duration=lengths, loop=0, optimize=True)


def _frame(panels: Sequence["_Panel"], scenes: Sequence[Scene]) -> None:
    """Show the same place at the same scale on all panels."""
    seen: list[Any] = [scene.position_m for scene in scenes]
    seen += [goal_m for scene in scenes for goal_m in scene.goals_m if goal_m]
    for each in (each for scene in scenes for each in scene.objects):
        seen += [each.position_m, each.goal_m or []]
    seen += [
        points for scene in scenes if scene.load for points in (scene.load.beam_m, [scene.load.target_m])
    ]
    everywhere = np.concatenate([np.reshape(points, (-1, 2)) for points in seen])
    low, high = np.nanmin(everywhere, 0), np.nanmax(everywhere, 0)
    middle, half = 0.5 * (low + high), 0.5 * float((high - low).max()) + 2.0 * scenes[0].radius_m
    for panel in panels:
        panel.axes.set_xlim(middle[0] - half, middle[0] + half)
        panel.axes.set_ylim(middle[1] - half, middle[1] + half)


def _draw(panels: Sequence["_Panel"], time_s: float) -> None:
    for panel in panels:
        panel.show(time_s)


class _Panel:
    """One scene on its axes."""

    def __init__(self, axes: "Axes", scene: Scene) -> None:
        from matplotlib.cm import ScalarMappable  # noqa: PLC0415  # an extra
        from matplotlib.colors import Normalize  # noqa: PLC0415

        self.axes, self._scene = axes, scene
        self._speed = np.linalg.norm(scene.velocity_m_s, axis=-1)
        top = scene.speed_limit_m_s or float(np.nanmax(self._speed, initial=0.1))
        self._colours = ScalarMappable(Normalize(0.0, top), "cividis")
        self._trail = max(1, round(TRAIL_S / scene.period_s))
        robots = scene.position_m.shape[1]
        self._trails = [
            axes.plot([], [], color=SERIES[robot % len(SERIES)], linewidth=1.2, alpha=0.7)[0]
            for robot in range(robots)
        ]
        self._margins = [
            disc((0, 0), 0.5 * (scene.margin_m or 0.0), fill=False, linestyle=":") for _ in range(robots)
        ]
        self._discs = [disc((0, 0), scene.radius_m) for _ in range(robots)]
        for patch in (*self._margins, *self._discs):
            axes.add_patch(patch)
        (self._beam,) = axes.plot([], [], color="#5b6875", linewidth=2.0)
        self._package = disc((0, 0), scene.load.radius_m if scene.load else 0.0, facecolor="#b42318")
        axes.add_patch(self._package)
        self._objects = [disc((0, 0), each.radius_m, facecolor="#b42318") for each in scene.objects]
        for patch in self._objects:
            axes.add_patch(patch)
        self._heights = [
            axes.text(0.0, 0.0, "", ha="center", va="center", fontsize=8, clip_on=True) for _ in range(robots)
        ]
        self._stand_still()

    def _stand_still(self) -> None:
        axes, scene = self.axes, self._scene
        for robot, goal_m in enumerate(scene.goals_m):
            axes.plot(
                *(goal_m or ([], [])), "x", color=SERIES[robot % len(SERIES)], markersize=7, markeredgewidth=2
            )
        for circle in scene.circles:
            axes.add_patch(disc(circle.centre_m, circle.radius_m, fill=False, edgecolor=OVER, linestyle="--"))
        for each in scene.objects:
            axes.plot(*(each.goal_m or ([], [])), "s", color="#2e7d32", markersize=9)
        if scene.load:
            axes.plot(*scene.load.target_m, "s", color="#2e7d32", markersize=9)
        axes.set_aspect("equal")
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_color("#d9dee4")

    def show(self, time_s: float) -> None:
        """Move everything to one moment."""
        scene, last = self._scene, len(self._scene.position_m) - 1
        row = min(last, int(time_s / scene.period_s))
        position, speed = scene.position_m[row], self._speed[row]
        place = position
        if scene.height_m is not None:
            place = np.column_stack([position, scene.height_m[row]])
            for text, centre, height in zip(self._heights, position, scene.height_m[row], strict=True):
                text.set(position=centre, text=f"{height:.1f} m")
        apart = np.linalg.norm(place[:, None] - place[None], axis=-1)
        np.fill_diagonal(apart, np.inf)
        fast = speed > (scene.speed_limit_m_s or math.inf) + 1e-6
        close = np.nanmin(apart, 1, initial=math.inf) < (scene.margin_m or 0.0) - 1e-6
        for robot, (trail, margin, body) in enumerate(
            zip(self._trails, self._margins, self._discs, strict=True)
        ):
            trail.set_data(*scene.position_m[max(0, row - self._trail) : row + 1, robot].T)
            margin.set(center=position[robot], edgecolor=OVER if close[robot] else "#9aa5b1")
            body.set(
                center=position[robot], facecolor=OVER if fast[robot] else self._colours.to_rgba(speed[robot])
            )
            body.set_edgecolor(SERIES[robot % len(SERIES)])
            body.set_linewidth(1.6)
        for patch, each in zip(self._objects, scene.objects, strict=True):
            patch.set(center=each.position_m[row])
        if scene.load:
            self._beam.set_data(*scene.load.beam_m[row].T)
            self._package.set(center=scene.load.package_m[row])
        self.axes.set_title(f"{scene.title}   {min(time_s, (last + 1) * scene.period_s):4.1f} s", fontsize=10)
        self.axes.set_xlabel(self._verdict(row), fontsize=9)

    def _verdict(self, row: int) -> str:
        scene, told = self._scene, []
        if scene.speed_limit_m_s is not None:
            broken = float(np.nanmean(self._speed[: row + 1] > scene.speed_limit_m_s + 1e-6))
            told.append(f"over {scene.speed_limit_m_s:g} m/s: {broken:.0%} of the time")
        return ", ".join(told)
