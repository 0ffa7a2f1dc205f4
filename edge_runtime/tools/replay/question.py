"""What would it have done: a log's ticks decided again by another policy, other objectives, or both.

Every tick starts from what was recorded: the answer is what the robot would have done in each situation that
it was in, not where that would have led.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from edge_runtime.messages import Command, Vector
from edge_runtime.recording.schema import Start, Tick
from edge_runtime.tools.replay.replay import Replay


@dataclass
class Answer:
    """What was done and what would have been, tick by tick."""

    start: Start
    times_s: list[float] = field(default_factory=list)
    """From the run's start."""
    positions_m: list[Vector] = field(default_factory=list)
    velocities_m_s: list[Vector] = field(default_factory=list)
    done: list[Command] = field(default_factory=list)
    instead: list[Command] = field(default_factory=list)

    def ask(self, tick: Tick, replay: Replay) -> None:
        """Ask about one tick."""
        self.times_s.append(tick.inputs.deadline_s - self.start.started_s)
        self.positions_m.append(tick.state.own.position_m)
        self.velocities_m_s.append(tick.state.own.velocity_m_s)
        self.done.append(tick.command)
        seen = replay.observe(tick)
        self.instead.append(replay.limit(tick, replay.act(tick, seen), seen))

    def changes(self) -> np.ndarray:
        """Distance (T,) between the actions done and instead, in the policy's action units."""
        return np.array([math.dist(a.action, b.action) for a, b in zip(self.done, self.instead, strict=True)])


def speeds_m_s(commands: Iterable[Command]) -> np.ndarray:
    """Commanded speeds (T,)."""
    return np.array([math.hypot(*command.velocity_m_s) for command in commands])
