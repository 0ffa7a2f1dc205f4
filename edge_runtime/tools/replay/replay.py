"""Runs a log's ticks again, stage by stage, each stage on what was recorded before it.

A difference therefore names the stage that makes it: ``observation`` (states to the policy's input),
``action`` (the guided sample, with the recorded start noise, and cut after as many steps) or ``command``
(limits). Equal means equal bit for bit, for every number of every record; where the log was made on a
processor that rounds otherwise, every number but counts is compared within `TOLERANCE`.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from edge_runtime.common.own_code import own_name
from edge_runtime.common.processor import processor
from edge_runtime.config.objectives import make_objective_set
from edge_runtime.control.limits import RobotLimits, limited, robot_limits
from edge_runtime.control.mission import NOWHERE
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import guide_for
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import Command, GuidedAction
from edge_runtime.objectives import Objective
from edge_runtime.observation import Source
from edge_runtime.observation.border import Border
from edge_runtime.observation.familiarity import Familiarity, Unfamiliar
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.adaptation import adapt
from edge_runtime.policy.backend import BACKENDS, Backend
from edge_runtime.policy.bundle import MANIFEST_FILE, Bundle
from edge_runtime.policy.compiled_policy import CompiledPolicy, compiled_engines
from edge_runtime.policy.velocity_field import VelocityField
from edge_runtime.recording.json_codec import encode
from edge_runtime.recording.schema import LoggedObjectiveSet, Observation, Start, Tick

TOLERANCE: Final = 1e-5
"""Between processors, relative to numbers above 1: actions of numpy differ by 6e-6, the kernel's by 1e-7."""
COUNTS: Final = ("conflicts", "opposed", "projections")
"""How often something happened in a flow: a number on the edge may fall to either side."""


class Difference(msgspec.Struct, frozen=True):
    """A number that came out otherwise."""

    tick: int
    stage: str
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        place = f"tick {self.tick}, stage {self.stage}"
        return f"{place}: {self.field} was {self.recorded}, replayed {self.replayed}"


class Replay:
    """One robot's decisions, made again.

    Args:
        start: of the log.
        bundle: the policy.
        policy: that policy on a backend, see `recorded_policy`.
        tolerance: how far numbers may lie apart; 0 for not at all.
        own: the sources of the user's own that may run here.

    Raises:
        ConfigError: if the policy observes by other code of somebody's own, or is for another body; from
            `observe` too.
    """

    def __init__(
        self,
        start: Start,
        bundle: Bundle,
        policy: VelocityField,
        tolerance: float = 0.0,
        own: Collection[type[Source]] = (),
    ) -> None:
        self.start, self.bundle, self.tolerance = start, bundle, tolerance
        self.unfamiliar: Counter[str] = Counter()
        """Ticks whose observation was outside of what training had, by the worst field."""
        self.worst = 0.0
        """Largest difference seen within the tolerance."""
        robots = {robot.robot_id: robot for robot in start.fleet.robots}
        adaptation = start.settings.adaptation
        bundle = adapt(bundle, adaptation)
        _check_size(start.fleet.dims, bundle.manifest.motion.dims, "positions")
        self._observer = Observer(
            bundle.manifest,
            robots[start.robot_id].goal_m or NOWHERE,
            adaptation.scale_m,
            own=own,
            path=str(bundle.directory / MANIFEST_FILE),
        )
        self._other_ranges = start.bundle.sha256 in bundle.manifest.supersedes
        observed, arena = bundle.manifest.observation, adaptation.training_arena
        _check_size(len(arena.low_m) if arena else start.fleet.dims, start.fleet.dims, "training's arena")
        self._familiarity, self._border = Familiarity(observed), Border(observed, arena, adaptation.scale_m)
        self._policy, self._manifest = policy, bundle.manifest
        self._limits = _limits(start, bundle)
        self.follow(ObjectiveSet())

    def follow(self, asked: ObjectiveSet) -> None:
        """Follow these objectives from here on."""
        self._guide = guide_for(self._manifest, asked)

    def observe(self, tick: Tick) -> Observation:
        """The observation of the recorded state."""
        inputs = tick.inputs
        _check_size(len(inputs.previous_action), self._manifest.action_dim, "actions")
        seen = self._observer.observe(
            tick.state, inputs.previous_action, inputs.elapsed_s, self._guide.ease_m
        )
        values, field = seen[0], self._familiarity.strangest(seen[0])
        self._border.clamp(seen)
        if field:
            self.unfamiliar[field] += 1
        if self._other_ranges:  # an earlier manifest of the policy judged by other ones, or by none
            return replace(tick.observation, values=tuple(values.tolist()))
        return Observation(tuple(values.tolist()), field, tick.observation.unfamiliar_s if field else 0.0)

    def act(self, tick: Tick, observation: Observation) -> GuidedAction:
        """The action for what `observe` returned last, cut short where the recorded one was."""
        if self._observer.fault:
            return GuidedAction((0.0,) * self._manifest.action_dim, 0, fault=self._observer.fault)
        most_steps = tick.action.steps if tick.action.cut else None
        inputs = np.array([observation.values], np.float32)
        return guided_action(
            self._policy, inputs, tick.state, self._guide, tick.inputs.start, most_steps=most_steps
        )

    def limit(self, tick: Tick, action: GuidedAction, seen: Observation) -> Command:
        """The command for an action, sampled from an observation."""
        then = tick.command
        rest = (0.0,) * len(then.velocity_m_s)
        previous = Command(then.robot_id, then.sequence - 1, then.stamp_s, tick.inputs.previous_action, rest)
        unfamiliar = Unfamiliar(seen.unfamiliar, seen.unfamiliar_s)
        return limited(action, tick.state, previous, self._limits, then.stamp_s, unfamiliar)

    def differences(self, tick: Tick) -> Iterator[Difference]:
        """Make a tick again; yield the first number that differs in each stage."""
        stages = (
            ("observation", tick.observation, self.observe(tick)),
            ("action", tick.action, self.act(tick, tick.observation)),
            ("command", tick.command, self.limit(tick, tick.action, tick.observation)),
        )
        for stage, recorded, replayed in stages:
            if encode(recorded) == encode(replayed):
                continue
            apart = _first_difference(recorded, replayed, self.tolerance)
            if apart is not None:
                yield Difference(tick.inputs.number, stage, *apart)
            else:
                self.worst = max(self.worst, *_distances(recorded, replayed))


def recorded_policy(start: Start, bundle: Bundle) -> tuple[VelocityField, float]:
    """Prepare the policy on the backend that the log was made with, or what comes nearest to it here.

    Returns:
        The policy, and how far its numbers may lie from the recorded ones: 0 where this machine computes the
        same bits, else `TOLERANCE`.

    Raises:
        PolicyError: if it cannot run the bundle.
    """
    backend, engine = start.settings.backend, start.settings.engine
    if backend == CompiledPolicy.backend and bundle.weights is not None and engine in compiled_engines():
        manifest = bundle.manifest
        return CompiledPolicy(bundle.weights, manifest.steps, 1, manifest.sampler, engine), 0.0
    if backend == CompiledPolicy.backend:
        return bundle.field("auto"), TOLERANCE
    known: Backend = next((name for name in BACKENDS if name == backend), "auto")
    return bundle.field(known), 0.0 if start.machine.processor == processor() else TOLERANCE


def recorded_objectives(
    chosen: LoggedObjectiveSet, path: Path, own: Collection[type[Objective]] = ()
) -> ObjectiveSet:
    """The settings and active objectives of a log's set.

    Args:
        chosen: what the log says.
        path: the log's name.
        own: the objectives of the user's own that it may name: nothing is imported on a log's word.

    Raises:
        ConfigError: if it names another one, or one that has other fields now.
    """
    guidance = {name: getattr(chosen, name) for name in GuidanceSettings.__struct_fields__}
    active = [logged for logged in chosen.objectives if logged.active]
    named = {own_name(kind) for kind in own}
    for logged in active:
        if ":" in logged.kind and logged.kind not in named:
            raise ConfigError(
                f"{path}: followed {logged.kind!r}, code that no log can make run here: name it with "
                f"--own {logged.kind}, or a fleet file that names it with --fleet"
            )
    tables = [{**logged.fields(), "type": logged.kind} for logged in active]
    return make_objective_set({"guidance": guidance, "objectives": tables}, path, own)


def _check_size(recorded: int, wanted: int, what: str) -> None:
    if recorded != wanted:
        raise ConfigError(f"the log's {what} have {recorded} components, the policy's {wanted}")


def _limits(start: Start, bundle: Bundle) -> RobotLimits:
    settings = start.settings
    return robot_limits(
        bundle.manifest,
        1.0 / settings.rate_hz,
        max_step=_limit(settings.max_step),
        max_state_age_s=settings.max_state_age_s,
        max_speed_m_s=_limit(settings.max_speed_m_s),
        max_unfamiliar_s=_limit(settings.max_unfamiliar_s),
        max_yaw_rate_rad_s=_limit(settings.max_yaw_rate_rad_s),
    )


def _limit(recorded: float | None) -> float:
    return math.inf if recorded is None else recorded


def _pairs(recorded: msgspec.Struct, replayed: msgspec.Struct) -> Iterator[tuple[str, object, object]]:
    """Every value of both, by its name; vectors of one length component by component."""
    for name in recorded.__struct_fields__:
        one, other = getattr(recorded, name), getattr(replayed, name)
        if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
            for index, (a, b) in enumerate(zip(one, other, strict=True)):
                yield f"{name}[{index}]", a, b
        else:
            yield name, one, other


def _first_difference(
    recorded: msgspec.Struct, replayed: msgspec.Struct, tolerance: float
) -> tuple[str, str, str] | None:
    """Name, and both values, of the first number that differs by more than the tolerance."""
    for name, one, other in _pairs(recorded, replayed):
        if _text(one) == _text(other):
            continue
        if tolerance and (name.partition("[")[0] in COUNTS or _distance(one, other) <= tolerance):
            continue
        return name, _text(one), _text(other)
    return None


def _distances(recorded: msgspec.Struct, replayed: msgspec.Struct) -> Iterator[float]:
    for name, one, other in _pairs(recorded, replayed):
        yield 0.0 if name.partition("[")[0] in COUNTS else _distance(one, other)


def _distance(one: object, other: object) -> float:
    """Between two numbers, relative to those above 1; infinite between other things that differ."""
    if isinstance(one, float) and isinstance(other, float):
        return 0.0 if one == other else abs(one - other) / max(1.0, abs(one))
    return 0.0 if one == other else math.inf


def _text(value: object) -> str:
    """A value as text; different for floats that differ, also in the sign of zero."""
    return repr(value)
