"""``python -m benchmarks husky-pictures``: the case study in pictures, after the paper's Figs. 4 and 5.

Huskies in three moments of an episode, LIMOs in three of one as under the paper's projector, and a moving
picture of the Huskies. Each robot draws its way in its colour, and a ring marks its goal. It needs off-screen
OpenGL: ``MUJOCO_GL=egl`` takes a driver's or Mesa's.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import mujoco
import numpy as np
from PIL import Image

from benchmarks.common.flags import make_parser
from benchmarks.husky.cases import ASKED, TASK, Case
from benchmarks.husky.play import play
from benchmarks.husky.teams import Teams, drawn
from edge_runtime.common.arrays import Floats
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.simulation.wheels.bases import BASES
from firmware_bridge.simulation.wheels.mjcf import COLOURS, GROUND

FOLDER: Final = Path(__file__).parents[2] / "docs" / "pictures"
PANEL: Final = (540, 720)
FILM: Final = (300, 560)
"""Height and width of a moment's picture, and of the moving one, in pixels."""
FILM_STEP: Final = 3
FILM_SPEED: Final = 3.0
"""Every third tick of the episode, thrice as fast."""
MOMENTS: Final = (0.25, 0.55, 1.0)
"""Of an episode's duration."""
RING: Final = 48
"""Pieces of a goal's ring."""


class Shot(NamedTuple):
    """An episode, and how it is looked at."""

    case: Case
    seed: int
    distance_m: float
    azimuth: float
    elevation: float
    ground: tuple[float, float, float, float] | None = None
    """Its colour; a chequered floor where None."""


HUSKIES: Final = Shot(Case("husky", 4, 0.7, "CFPG"), 207, 12.5, 90.0, -48.0)
LIMOS: Final = Shot(Case("limo", 4, 0.7, "CFPG"), 53, 5.0, 90.0, -64.0, (0.09, 0.1, 0.13, 1.0))


class Film(NamedTuple):
    """What was recorded, a row a tick."""

    attitudes: Floats
    """(T, nq) MuJoCo's positions."""
    places_m: Floats
    """(T, N, 2) of the points of reference."""
    goals_m: Floats


class Camera:
    """Draws moments of a film.

    Args:
        shot: what of, and how.
        size: height and width in pixels.
    """

    def __init__(self, shot: Shot, size: tuple[int, int]) -> None:
        asked, places = ASKED[shot.case.base], drawn([shot.seed], shot.case.robots)
        self._world = Teams(BASES[shot.case.base], asked.scale_m, places, shot.case.friction).world
        self._unit = asked.scale_m / 6.0
        model = self._world.model
        model.stat.extent = 14.0 * self._unit
        model.vis.map.zfar = 4.0
        model.light_dir[0] = (0.0, 0.0, -1.0)  # from aside, the ground would shade itself
        if shot.ground:
            model.geom_matid[GROUND] = -1
            model.geom_rgba[GROUND] = shot.ground
        self._renderer = mujoco.Renderer(model, *size)
        self._view = mujoco.MjvCamera()
        self._view.distance, self._view.azimuth, self._view.elevation = shot[2:5]

    def picture(self, film: Film, tick: int) -> Image.Image:
        """Draw a tick, with the ways that led there."""
        seen = np.concatenate([film.places_m.reshape(-1, 2), film.goals_m])
        self._view.lookat[:2] = (seen.min(0) + seen.max(0)) / 2
        self._world.data.qpos[:] = film.attitudes[tick]
        mujoco.mj_forward(self._world.model, self._world.data)
        self._renderer.update_scene(self._world.data, self._view)
        for robot in range(film.places_m.shape[1]):
            colour = np.array([*map(float, COLOURS[robot % len(COLOURS)].split())], np.float32)
            self._line(film.places_m[: tick + 1, robot], 0.045 * self._unit, colour)
            angles = np.linspace(0.0, 2.0 * np.pi, RING + 1)
            ring = 0.6 * self._unit * np.stack([np.cos(angles), np.sin(angles)], -1)
            self._line(film.goals_m[robot] + ring, 0.06 * self._unit, colour)
        return Image.fromarray(self._renderer.render())

    def _line(self, points_m: Floats, radius_m: float, colour: object) -> None:
        """Draw a line on the ground."""
        scene = self._renderer.scene
        for start, end in pairwise(points_m):
            if scene.ngeom >= scene.maxgeom:
                return
            piece = scene.geoms[scene.ngeom]
            kind = mujoco.mjtGeom.mjGEOM_CAPSULE
            mujoco.mjv_initGeom(piece, kind, np.zeros(3), np.zeros(3), np.zeros(9), colour)
            mujoco.mjv_connector(piece, kind, radius_m, np.array([*start, 0.0]), np.array([*end, 0.0]))
            piece.emission = 0.4
            scene.ngeom += 1


def recorded(shot: Shot) -> Film:
    """Drive the episode."""
    attitudes, places, scale_m = [], [], ASKED[shot.case.base].scale_m

    def watch(teams: Teams) -> None:
        attitudes.append(teams.world.data.qpos.copy())
        places.append(scale_m * teams.position[0])

    play(shot.case, packaged_bundle(TASK), [shot.seed], watch)
    goals = scale_m * drawn([shot.seed], shot.case.robots).goals[0]
    return Film(np.array(attitudes), np.array(places), goals)


def main(arguments: Sequence[str]) -> int:
    """Draw everything."""
    parser = make_parser("husky-pictures", __doc__)
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help="where the pictures go")
    folder: Path = parser.parse_args(arguments).out
    folder.mkdir(parents=True, exist_ok=True)
    huskies = recorded(HUSKIES)
    _side_by_side(Camera(HUSKIES, PANEL), huskies).save(folder / "huskies.png", optimize=True)
    _side_by_side(Camera(LIMOS, PANEL), recorded(LIMOS)).save(folder / "limos.png", optimize=True)
    camera, last = Camera(HUSKIES, FILM), len(huskies.attitudes) - 1
    pictures = [camera.picture(huskies, tick) for tick in range(0, last + 1, FILM_STEP)]
    palette = _palette(pictures[-1])
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    frame_ms = round(1e3 * FILM_STEP * packaged_bundle(TASK).manifest.motion.dt_s / FILM_SPEED)
    held = [frame_ms] * (len(frames) - 1) + [2000]
    frames[0].save(folder / "husky.gif", save_all=True, append_images=frames[1:], duration=held, loop=0)
    for name in ("huskies.png", "limos.png", "husky.gif"):
        print(f"{folder / name}: {(folder / name).stat().st_size / 1e3:.0f} kB")
    return 0


def _palette(picture: Image.Image) -> Image.Image:
    """Colours of the ground, which fills most of a picture, and those of the little that is colourful."""
    most, least = (
        picture.quantize(128, how) for how in (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE)
    )
    both = Image.new("P", (1, 1))
    both.putpalette([*(most.getpalette() or ())[: 3 * 128], *(least.getpalette() or ())[: 3 * 128]])
    return both


def _side_by_side(camera: Camera, film: Film) -> Image.Image:
    """The episode's moments, the earliest on the left."""
    panels = [camera.picture(film, round(share * (len(film.attitudes) - 1))) for share in MOMENTS]
    whole = Image.new("RGB", (sum(one.width for one in panels), panels[0].height))
    for place, panel in enumerate(panels):
        whole.paste(panel, (place * panel.width, 0))
    return whole
