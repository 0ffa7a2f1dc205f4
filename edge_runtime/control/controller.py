"""One robot's decision: what it observes, the action it samples, the command within its limits."""

import math
import random

import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.control.limits import RobotLimits, first_command, limited
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import Guide
from edge_runtime.messages import Command, GuidedAction, RobotState, TeamState, Vector
from edge_runtime.observation.belief import Beliefs
from edge_runtime.observation.border import Border
from edge_runtime.observation.familiarity import FAMILIAR, Familiarity
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.velocity_field import VelocityField


class Controller:
    """The stages of one robot's tick, in order: ``believe``, ``observe``, ``act``, ``limit``.

    Args:
        robot_id: whose commands these are.
        observer: composes its observations.
        policy: a velocity field of batch 1; controllers that take turns may share one.
        guide: the objectives in force.
        limits: what it may be commanded.
        familiarity: knows what the policy saw in training.
        border: of the policy's arena, on which it observes places beyond; they are unfamiliar all the same.
        beliefs: what the robot works out for itself.
        seed: of the flow's start noise.
    """

    def __init__(
        self,
        robot_id: int,
        observer: Observer,
        policy: VelocityField,
        guide: Guide,
        limits: RobotLimits,
        familiarity: Familiarity,
        border: Border,
        beliefs: Beliefs,
        seed: int = 0,
    ) -> None:
        self.robot_id = robot_id
        self.policy = policy
        self.guide = guide
        """The objectives in force; between ticks it may be exchanged."""
        self.command = first_command(robot_id, len(limits.low), limits.preview.dims)
        """The newest command."""
        self.start: Vector = self.command.action
        """Where the newest sample's flow began."""
        self.elapsed_s = 0.0
        """From the first state that it observed to the newest."""
        self.limits = limits
        self.unfamiliar = FAMILIAR
        """What the newest observation has that training never had."""
        self._familiarity, self._strangest = familiarity, ""
        self._observer, self._border, self._beliefs = observer, border, beliefs
        self._first_s: float | None = None
        self._random = random.Random(seed)

    def believe(self, team: TeamState) -> TeamState:
        """Add what the robot believes to what it knows in this tick."""
        return self._beliefs.added(team)

    def observe(self, team: TeamState) -> Array:
        """Compose the observation (1, O); the next call reuses it."""
        if self._first_s is None:
            self._first_s = team.own.stamp_s
        self.elapsed_s = team.own.stamp_s - self._first_s
        observation = self._observer.observe(team, self.command.action, self.elapsed_s, self.guide.ease_m)
        self._strangest = self._familiarity.strangest(observation[0])
        self._border.clamp(observation)
        return observation

    def act(self, observation: Array, team: TeamState, deadline_s: float = math.inf) -> GuidedAction:
        """Sample a guided action by ``deadline_s``, a `time.monotonic` time; zero if a source failed."""
        self.start = self._draw_start()
        if self._observer.fault:
            return GuidedAction((0.0,) * len(self.command.action), 0, fault=self._observer.fault)
        return guided_action(self.policy, observation, team, self.guide, self.start, deadline_s)

    def limit(self, guided: GuidedAction, team: TeamState, now_s: float) -> Command:
        """Turn the action into this tick's command."""
        self.unfamiliar = self._familiarity.follow(self._strangest, now_s)
        self.command = limited(guided, team, self.command, self.limits, now_s, self.unfamiliar)
        return self.command

    def decide(self, team: TeamState, now_s: float) -> Command:
        """All stages at once, without a deadline."""
        team = self.believe(team)
        return self.limit(self.act(self.observe(team), team), team, now_s)

    def succeed(self, before: "Controller") -> None:
        """Go on where another controller of the same robot ends: its newest command, time, beliefs."""
        self.command, self._first_s = before.command, before._first_s
        self._beliefs = before._beliefs

    def rehearse(self) -> None:
        """Compute a tick to throw away, which leaves no trace: it wakes the processor and its caches.

        The tick after it takes 0.19 ms instead of 0.34 (compiled, 50 Hz; ``benchmarks latency``).
        """
        observation = np.zeros((1, self.policy.observation_dim), np.float32)
        place = (0.0,) * self.limits.preview.dims
        own = RobotState(self.robot_id, 0.0, place, place)
        guided_action(self.policy, observation, TeamState(own), self.guide, (0.0,) * len(self.limits.low))

    def _draw_start(self) -> Vector:
        noise, components = self.guide.start_noise, len(self.limits.low)
        if not noise:
            return (0.0,) * components
        return tuple([self._random.gauss(0.0, noise) for _ in range(components)])
