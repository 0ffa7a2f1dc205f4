"""Runs a log's ticks again, stage by stage, each stage on what was recorded before it.

A difference therefore names the stage that makes it: ``observation`` (states to the policy's input),
``action`` (the guided sample, with the recorded start noise, and cut after as many steps) or ``command``
(limits). Equal means equal bit for bit, for every number of every record.
"""

import math
from collections.abc import Collection, Iterator
from pathlib import Path

import msgspec
import numpy as np

from edge_runtime.config.objectives import make_objective_set, own_name
from edge_runtime.control.limits import RobotLimits, limited
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import Command, GuidedAction
from edge_runtime.objectives import Objective
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.backend import BACKENDS
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.compiled_policy import CompiledPolicy, load_kernel
from edge_runtime.policy.velocity_field import VelocityField
from edge_runtime.recording.json_codec import encode
from edge_runtime.recording.schema import LoggedObjectiveSet, Observation, Start, Tick


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

    Raises:
        PolicyError: if the policy observes something that a log does not hold.
    """

    def __init__(self, start: Start, bundle: Bundle, policy: VelocityField) -> None:
        robots = {robot.robot_id: robot for robot in start.fleet.robots}
        self._observer = Observer(bundle.manifest, robots[start.robot_id].goal_m)
        self._policy, self._dynamics = policy, bundle.manifest.dynamics
        self._limits = _limits(start, bundle)
        self._guide = make_guide(ObjectiveSet(), self._dynamics)

    def follow(self, asked: ObjectiveSet) -> None:
        """Follow these objectives from here on."""
        self._guide = make_guide(asked, self._dynamics)

    def observe(self, tick: Tick) -> Observation:
        """The observation of the recorded state."""
        return Observation(tuple(self._observer.observe(tick.state)[0].tolist()))

    def act(self, tick: Tick, observation: Observation) -> GuidedAction:
        """The action for an observation, cut short where the recorded one was."""
        most_steps = tick.action.steps if tick.action.cut else None
        inputs = np.array([observation.values], np.float32)
        return guided_action(
            self._policy, inputs, tick.state, self._guide, tick.inputs.start, most_steps=most_steps
        )

    def limit(self, tick: Tick, action: GuidedAction) -> Command:
        """The command for an action."""
        then = tick.command
        previous = Command(
            then.robot_id, then.sequence - 1, then.stamp_s, tick.inputs.previous_action, (0.0, 0.0)
        )
        return limited(action, tick.state, previous, self._limits, then.stamp_s)

    def differences(self, tick: Tick) -> Iterator[Difference]:
        """Make a tick again; yield the first number that differs in each stage."""
        stages = (
            ("observation", tick.observation, self.observe(tick)),
            ("action", tick.action, self.act(tick, tick.observation)),
            ("command", tick.command, self.limit(tick, tick.action)),
        )
        for stage, recorded, replayed in stages:
            if encode(recorded) != encode(replayed):
                yield Difference(tick.inputs.number, stage, *_first_difference(recorded, replayed))


def recorded_policy(start: Start, bundle: Bundle) -> VelocityField:
    """Prepare the policy on the backend that the log was made with.

    Raises:
        ConfigError: if this machine does not have it: another instruction set computes other bits.
        PolicyError: if it cannot run the bundle.
    """
    backend, engine = start.settings.backend, start.settings.engine
    if backend == CompiledPolicy.backend and bundle.weights is not None:
        engines = load_kernel().engines()
        if engine not in engines:
            raise ConfigError(
                f"the log was made with the compiled kernel's {engine} engine; this machine has "
                f"{', '.join(engines)}: replay it where {engine} is to be had"
            )
        return CompiledPolicy(bundle.weights, bundle.manifest.euler_steps, engine=engine)
    return bundle.field(next((known for known in BACKENDS if known == backend), "auto"))


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


def _limits(start: Start, bundle: Bundle) -> RobotLimits:
    settings, (x, y) = start.settings, bundle.manifest.action
    return RobotLimits(
        low=(x.low, y.low),
        high=(x.high, y.high),
        preview=bundle.manifest.dynamics.at_period(1.0 / settings.rate_hz).preview(1),
        max_step=math.inf if settings.max_step is None else settings.max_step,
        max_state_age_s=settings.max_state_age_s,
        max_speed_m_s=math.inf if settings.max_speed_m_s is None else settings.max_speed_m_s,
    )


def _first_difference(recorded: msgspec.Struct, replayed: msgspec.Struct) -> tuple[str, str, str]:
    """Name, and both values, of the first number that differs."""
    for name in recorded.__struct_fields__:
        one, other = getattr(recorded, name), getattr(replayed, name)
        if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
            for index, pair in enumerate(zip(one, other, strict=True)):
                if _text(pair[0]) != _text(pair[1]):
                    return f"{name}[{index}]", _text(pair[0]), _text(pair[1])
        elif _text(one) != _text(other):
            return name, _text(one), _text(other)
    raise ValueError("both are equal")


def _text(value: object) -> str:
    """A value as text; different for floats that differ, also in the sign of zero."""
    return repr(value)
