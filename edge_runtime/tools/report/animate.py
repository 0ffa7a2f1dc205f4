"""``edge-run --animate``: the picture of a run, from its log."""

from itertools import chain
from pathlib import Path

import numpy as np

from edge_runtime.errors import ConfigError
from edge_runtime.messages import Place, Vector2
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.wire import LogReport
from edge_runtime.tools.report.digest import RunDigest, digest
from edge_runtime.tools.report.page.animation import Moving, Scene, animate, check_target
from edge_runtime.tools.report.team import fences, limits, team_of


def check_animation(path: Path, *, recorded: bool) -> None:
    """Find out before the run whether it can be drawn.

    Raises:
        ConfigError: says what is missing.
    """
    if not recorded:
        raise ConfigError(f"--animate {path}: draws the run's log; leave --no-log out")
    check_target(path)


def animate_run(log: LogReport, path: Path) -> None:
    """Draw the run whose newest log file a report names.

    Raises:
        ConfigError: if the log cannot be read.
    """
    newest = Path(log.path)
    parts = sorted(newest.parent.glob(f"{newest.stem.rpartition('_')[0]}_*.mcap"))
    records = chain.from_iterable(map(read_log, parts))
    run = digest((record for record in records if not isinstance(record, Damage)), log.path)
    if not len(run.time_s):
        raise ConfigError(f"--animate {path}: the run has no ticks to draw")
    animate([scene_of(run)], path)


def scene_of(run: RunDigest) -> Scene:
    """Return the team as one robot saw it.

    Raises:
        ConfigError: if it saw nobody.
    """
    places = [place for place in run.start.fleet.robots if place.robot_id in run.motion]
    if not places:
        raise ConfigError("the log says of no robot of its fleet where it was")
    motion = np.stack([run.motion[place.robot_id] for place in places], 1)
    team, dims = team_of([run]), run.start.fleet.dims
    speeds = limits(team, "speed_limit", "limit_m_s", "m/s")
    margins = limits(team, "safety_margin", "distance_m", "m")
    return Scene(
        title=f"{run.start.bundle.name}",
        period_s=(run.time_s[-1] - run.time_s[0]) / max(1, len(run.time_s) - 1) or 1.0,
        position_m=motion[..., :2],
        velocity_m_s=motion[..., dims:],
        height_m=motion[..., 2] if dims == 3 else None,
        goals_m=[_in_plane(place.goal_m) for place in places],
        radius_m=run.start.bundle.radius_m,
        speed_limit_m_s=min((limit.value for limit in speeds), default=None),
        margin_m=max((limit.value for limit in margins), default=None),
        circles=fences(team),
        objects=[
            Moving(one.position_m, one.place.radius_m, _in_plane(one.place.goal_m)) for one in team.objects
        ],
    )


def _in_plane(place: Place | None) -> Vector2 | None:
    """A place as it is seen from above."""
    return (place[0], place[1]) if place else None
