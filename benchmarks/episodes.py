"""Navigation episodes in VMAS, every action computed by the deployed numpy runtime.

Each robot decides as it would on its own computer: it observes, knows its teammates' states and the
actions that they commanded last, and guides its own flow. Only the loop over robots is batched.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from edge_runtime.guidance.batch import guided_actions
from edge_runtime.guidance.settings import GuidanceSettings, Guide
from edge_runtime.motion.outlook import Floats, TeamBatch
from edge_runtime.objectives import Objective, SafetyMargin, SpeedLimit
from edge_runtime.observation.observer import observe_batch
from edge_runtime.policy.bundle import Bundle
from export.scenarios.navigation import FACTS, Navigation

CHUNK = 100
"""Episodes that run side by side."""


@dataclass(frozen=True)
class Episodes:
    """E episodes of one setting; each counts until all robots have arrived or its time is up."""

    arrived: npt.NDArray[np.bool_]
    """(E,): all robots at their goals at once, before any collision."""
    collided: npt.NDArray[np.bool_]
    """(E,): two robots touched."""
    steps: npt.NDArray[np.int64]
    """(E,) control steps."""
    speeding: Floats
    """(E,): share of the robots' steps above the speed limit."""
    too_close: Floats
    """(E,): share of the steps with two robots inside the safety margin."""


class _Team:
    """The states of E teams of N robots as E N views of a team."""

    def __init__(self, episodes: int, robots: int) -> None:
        self._mates = np.array([[mate for mate in range(robots) if mate != own] for own in range(robots)])
        self._own = np.tile(np.arange(robots), episodes)
        self._mate_ids = np.tile(self._mates, (episodes, 1))

    def views(self, position: Floats, velocity: Floats, action: Floats) -> TeamBatch:
        """Arrange (E, N, 2) positions, velocities and last actions as each robot sees them."""
        rows, count = len(self._own), self._mates.shape[1]

        def mates(values: Floats) -> Floats:
            return values[:, self._mates].reshape(rows, count, 2)

        return TeamBatch(
            robot_id=self._own,
            position_m=position.reshape(rows, 2),
            velocity_m_s=velocity.reshape(rows, 2),
            mate_id=self._mate_ids,
            mate_position_m=mates(position),
            mate_velocity_m_s=mates(velocity),
            mate_action=mates(action),
        )


def run_episodes(
    bundle: Bundle,
    objectives: tuple[Objective, ...],
    settings: GuidanceSettings,
    limits: tuple[SpeedLimit, SafetyMargin],
    episodes: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
) -> Episodes:
    """Run fresh episodes; the seed decides starts, goals and the flow's start noise.

    Args:
        bundle: the policy.
        objectives: what guides it; none leaves it unguided.
        settings: mode, scale and start noise.
        limits: what the violations are measured against.
        episodes: E.
        seed: chunks of `CHUNK` episodes use seeds that follow it.
        progress: called with the number of episodes just finished.
    """
    chunks = []
    for first in range(0, episodes, CHUNK):
        count = min(CHUNK, episodes - first)
        chunks.append(_run_chunk(bundle, objectives, settings, limits, count, seed * 10_000 + first))
        progress(count)
    fields = Episodes.__dataclass_fields__
    return Episodes(*(np.concatenate([getattr(chunk, field) for chunk in chunks]) for field in fields))


def _run_chunk(
    bundle: Bundle,
    objectives: tuple[Objective, ...],
    settings: GuidanceSettings,
    limits: tuple[SpeedLimit, SafetyMargin],
    count: int,
    seed: int,
) -> Episodes:
    world = Navigation(count, seed, torch.device("cpu"), training=False)
    robots, manifest = FACTS.robots, bundle.manifest
    team, draw = _Team(count, robots), np.random.default_rng(seed)
    policy = bundle.policy(batch=count * robots)
    guide = Guide(settings, objectives, manifest.dynamics)
    low, high = ([getattr(field, end) for field in manifest.action] for end in ("low", "high"))
    position, velocity, goal = _states(world)
    action = np.zeros_like(position)
    tally = _Tally(count, limits)
    for _ in range(FACTS.evaluation_steps):
        views = team.views(position, velocity, action)
        observation = observe_batch(manifest, views, goal.reshape(-1, 2))
        start = settings.start_noise * draw.standard_normal((count * robots, 2))
        sampled = guided_actions(policy, observation, views, guide, start)
        action = np.clip(sampled, low, high).reshape(count, robots, 2)
        transition = world.step(torch.from_numpy(action).float())
        position, velocity, goal = _states(world)
        tally.add(position, velocity, transition.succeeded.numpy(), transition.failed.numpy())
        if not tally.running.any():
            break
    return tally.episodes()


def _states(world: Navigation) -> tuple[Floats, Floats, Floats]:
    state = world.state_dict()
    return tuple(state[name].double().numpy() for name in ("position", "velocity", "goal"))


class _Tally:
    """Counts of the episodes that still run."""

    def __init__(self, count: int, limits: tuple[SpeedLimit, SafetyMargin]) -> None:
        self.running = np.ones(count, bool)
        self._limit, self._margin = limits[0].limit_m_s, limits[1].distance_m
        self._arrived, self._collided = np.zeros(count, bool), np.zeros(count, bool)
        self._steps = np.zeros(count, np.int64)
        self._speeding, self._too_close = np.zeros(count), np.zeros(count)

    def add(
        self,
        position: Floats,
        velocity: Floats,
        succeeded: npt.NDArray[np.bool_],
        failed: npt.NDArray[np.bool_],
    ) -> None:
        """Count one control step; the tolerance of 1e-6 is VMAS' single precision."""
        running = self.running
        self._steps += running
        speeding = np.linalg.norm(velocity, axis=-1) > self._limit + 1e-6
        self._speeding += running * speeding.mean(1)
        first, second = np.triu_indices(position.shape[1], 1)
        closest = np.linalg.norm(position[:, first] - position[:, second], axis=-1).min(1)
        self._too_close += running * (closest < self._margin - 1e-6)
        self._collided |= running & failed
        self._arrived |= running & succeeded & ~self._collided
        self.running = running & ~succeeded

    def episodes(self) -> Episodes:
        """Return what was counted."""
        steps = self._steps
        return Episodes(self._arrived, self._collided, steps, self._speeding / steps, self._too_close / steps)
