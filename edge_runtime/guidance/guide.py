"""The objectives in force, made ready for one robot: previews and factors, computed once."""

import functools
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from edge_runtime.errors import ConfigError
from edge_runtime.guidance.projection import Projection
from edge_runtime.guidance.settings import PREFERENCE_RATE, PREFERENCE_STEPS, Mode, ObjectiveSet
from edge_runtime.messages import TeamState, Vector2
from edge_runtime.motion.linear import in_numbers
from edge_runtime.motion.model import Model
from edge_runtime.motion.outlook import Outlook, look_ahead
from edge_runtime.motion.prediction import Preview
from edge_runtime.motion.range_sensor import RangeSensor
from edge_runtime.objectives import BUILT_IN, Objective, SafetyMargin
from edge_runtime.policy.manifest import FlowStart, Manifest
from edge_runtime.policy.velocity_field import PYTHON, Steering, Term

PROJECTIONS: Final[dict[Mode, Projection]] = {
    "none": "none",
    "hierarchical": "hierarchical",
    "cone": "cone",
    "terminal": "hierarchical",
    "correction": "none",
}
"""How each mode resolves conflicts along the flow."""


class Guide(msgspec.Struct, frozen=True):
    """An `ObjectiveSet` made ready for one robot; the loop takes it up by one assignment.

    Its M objectives are those that steer: of positive weight, and none if the scale is zero or the robot is
    not to be guided. They are told by their places.
    """

    asked: ObjectiveSet
    """What somebody asked for."""
    objectives: tuple[Objective, ...]
    """(M,)"""
    previews: tuple[Preview, ...]
    """(M,): what each one sees of the robot's motion."""
    horizons_s: tuple[float, ...]
    """(M,): how far ahead that is."""
    sees_team: tuple[bool, ...]
    """(M,): whether it is shown the teammates."""
    factors: tuple[float, ...]
    """(M,): eta lambda_m."""
    steering: Steering
    """All of it in plain numbers, for policies that take a flow's steps at once."""
    tracked: tuple[str, ...]
    """Names of the tracked objects that the steering's terms know by their places here."""
    projection: Projection
    """How conflicts are resolved along the flow."""
    steers: bool
    """Whether objectives steer along the flow: all modes but ``correction``."""
    corrected: bool
    """Whether the finished action is corrected at tau = 1: modes ``terminal`` and ``correction``."""
    preferences: tuple[int, ...]
    """Those that move the finished action so far at most as `reach_now` says."""
    requirements: tuple[int, ...]
    """Those that move it as far as it takes."""
    start_noise: float
    """Deviation of the flow's start."""
    ease_m: float
    """How much farther away than they are the policy sees teammates; 0 where no margin keeps them apart."""
    digest: int
    """See `digest_of`."""
    sensor: RangeSensor | None = None
    """By which readings are told from teammates; None where no objective is to see obstacles."""
    version: int = 0
    """0 is what the robot was started with; each set that the team agrees on has a higher one."""

    def outlook(self, place: int, team: TeamState, obstacles: tuple[Vector2, ...]) -> Outlook:
        """What the objective at this place sees in one tick."""
        ahead = self.previews[place], obstacles, self.horizons_s[place], self.sees_team[place]
        return look_ahead(team, *ahead)


def make_guide(
    asked: ObjectiveSet,
    model: Model,
    start: FlowStart = "noise",
    sensor: RangeSensor | None = None,
    *,
    guided: bool = True,
) -> Guide:
    """Make objectives ready for a robot.

    Args:
        asked: the objectives, and how they are to guide.
        model: how the policy's robot moves. Objectives look ahead in its control steps, whatever rate it is
            run at.
        start: what its flow was trained to start from.
        sensor: the robot's range sensor, for objectives over obstacles.
        guided: False lets the flow alone: none of the objectives steers.

    Raises:
        ConfigError: as `check_objectives`.
    """
    followed = asked if guided else msgspec.structs.replace(asked, objectives=())
    check_objectives(followed, model)
    settings = followed.guidance
    active = tuple(o for o in followed.objectives if settings.scale * o.weight > 0.0)
    corrected = settings.mode in ("terminal", "correction") and bool(active)
    places = range(len(active) if corrected else 0)
    previews = tuple(model.preview(objective.look_ahead) for objective in active)
    horizons_s = tuple(objective.look_ahead * model.dt_s for objective in active)
    tracked = tuple(dict.fromkeys(name for each in active for name in each.looks_at))
    projection, steers = PROJECTIONS[settings.mode], settings.mode != "correction" and bool(active)
    terms = tuple(
        _term(each, preview, horizon_s, settings.scale, tracked)
        for each, preview, horizon_s in zip(active, previews, horizons_s, strict=True)
    )
    rounds = PREFERENCE_STEPS if corrected else -1
    # What a step linearises away adds up: who steers by turning comes nearer to the others with each.
    steps = settings.requirement_steps if all(map(in_numbers, previews)) else 1
    return Guide(
        asked=asked,
        objectives=active,
        previews=previews,
        horizons_s=horizons_s,
        # A subclass may cost something else: what its parent states does not count.
        sees_team=tuple(vars(type(each)).get("sees_team", True) for each in active),
        factors=tuple(settings.scale * objective.weight for objective in active),
        steering=Steering(
            projection,
            steers,
            terms,
            model.dims,
            rounds,
            PREFERENCE_RATE,
            steps,
        ),
        tracked=tracked,
        projection=projection,
        steers=steers,
        corrected=corrected,
        preferences=tuple(m for m in places if active[m].preference),
        requirements=tuple(m for m in places if not active[m].preference),
        start_noise=settings.start_noise if start == "noise" else 0.0,
        ease_m=settings.ease_m if corrected and _kept_apart(active, sensor) else 0.0,
        digest=digest_of(followed),
        sensor=sensor if model.dims == 2 else None,
    )


def _kept_apart(objectives: Sequence[Objective], sensor: RangeSensor | None) -> bool:
    """Whether a margin keeps the robots from touching each other; a subclass may cost something else."""
    touching_m = 2.0 * sensor.radius_m if sensor else 0.0
    return any(type(each) is SafetyMargin and each.distance_m >= touching_m for each in objectives)


def _term(
    objective: Objective, preview: Preview, horizon_s: float, scale: float, tracked: Sequence[str]
) -> Term:
    """An objective in plain numbers; one that those cannot state is computed in Python."""
    weight, motion = objective.weight, in_numbers(preview)
    if not motion or type(objective) not in BUILT_IN:
        return Term(PYTHON, scale * weight, weight, objective.preference, horizon_s, (), ())
    seen = tuple(float(tracked.index(name)) for name in objective.looks_at)
    numbers = (*objective.kernel_numbers(), *seen)
    return Term(objective.name, scale * weight, weight, objective.preference, horizon_s, motion, numbers)


def check_objectives(asked: ObjectiveSet, model: Model, source: str = "") -> None:
    """Refuse objectives that cannot be asked of a robot that moves so.

    Args:
        asked: the objectives.
        model: how the robot moves.
        source: what says so, for the error.

    Raises:
        ConfigError: names the objective, the motion model and why.
    """
    for index, objective in enumerate(asked.objectives):
        if reason := objective.refuses(model):
            space = " in space" if model.dims == 3 else ""
            raise ConfigError(
                f"{source}objectives[{index}]: {objective.name} cannot be used with motion model "
                f"{model.kind!r}{space}: {reason}"
            )


def guide_for(manifest: Manifest, asked: ObjectiveSet, *, guided: bool = True) -> Guide:
    """Make objectives ready for a robot that runs a bundle's policy; see `make_guide`."""
    return make_guide(asked, manifest.motion, manifest.start, manifest.body.sensor(), guided=guided)


def digest_of(asked: ObjectiveSet) -> int:
    """First 64 bits of the SHA-256 of what objectives and guidance say, whatever the form of their file.

    The code of own objectives counts too: robots with different code disagree.
    """
    digest = hashlib.sha256(msgspec.json.encode(asked))
    for objective in asked.objectives:
        if type(objective) not in BUILT_IN:
            digest.update(_code_digest(type(objective)))
    return int.from_bytes(digest.digest()[:8], "little")


@functools.cache
def _code_digest(kind: type[Objective]) -> bytes:
    """SHA-256 of a class's module file, as it was when the class was first followed; of nothing without."""
    module: Any = sys.modules.get(kind.__module__)
    file = getattr(module, "__file__", None)
    return hashlib.sha256(Path(file).read_bytes() if file else b"").digest()
