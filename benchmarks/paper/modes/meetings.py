"""Two robots that meet head-on, and the sides on which they pass: whether a policy has more than one way.

VMAS Navigation: robots 0 and 1 change places along a line, the other two stand on goals of their own, far
from it. Every episode of a scene starts in the very same state; only the flow's start noise differs.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from benchmarks.paper.episodes import play
from benchmarks.paper.judges import Flags, motion
from benchmarks.paper.methods import MakeDecide
from benchmarks.paper.rows import Setting
from edge_runtime.common.arrays import Floats
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import Navigation
from export.scenarios.scenario import Scenario, Transition

HALF_WAY_M = 0.6
PARKED_M = 0.95
"""How far from the middle the other two stand, beyond everybody's sensor."""


@dataclass(frozen=True)
class Meetings:
    """E episodes."""

    side: npt.NDArray[np.int64]
    """(E,): 1 where both kept to their left, -1 to their right, 0 where they never passed."""
    arrival: Floats
    """(E,): steps until all robots stood on their goals; infinite where they never did."""
    collided: Flags
    """(E,): robots touched before they had arrived."""


class MeetingJudge:
    """Follows E meetings to the end of their time.

    Args:
        heading: (E, 2), unit vectors in which robot 0 drives; robot 1 comes from there.
    """

    def __init__(self, heading: Floats) -> None:
        episodes = len(heading)
        self.running = np.ones(episodes, bool)
        self._heading, self._left = heading, _left_of(heading)
        self._side, self._collided = np.zeros(episodes, np.int64), np.zeros(episodes, bool)
        self._arrival, self._steps = np.full(episodes, np.inf), 0

    def add(self, world: Scenario, transition: Transition) -> None:
        """Take one step; robots pass where 0 gets ahead of 1, on the side on which it then is."""
        position, _ = motion(world)
        self._steps += 1
        apart = position[:, 0] - position[:, 1]
        ahead, left = (apart * self._heading).sum(-1), (apart * self._left).sum(-1)
        passing = (self._side == 0) & (ahead > 0.0)
        self._side[passing] = np.where(left > 0.0, 1, -1)[passing]
        self._collided |= transition.failed.numpy() & np.isinf(self._arrival)
        self._arrival[transition.succeeded.numpy() & np.isinf(self._arrival)] = self._steps

    def meetings(self) -> Meetings:
        """Return what was followed."""
        return Meetings(self._side, self._arrival, self._collided)


def meet(make_decide: MakeDecide, angle_rad: Floats, seed: int) -> tuple[Meetings, Floats]:
    """Run E meetings, robot 0 driving in directions (E,); the seed is of the noise.

    Returns:
        What came of them, and all positions (steps, E, N, 2).
    """
    heading = np.stack([np.cos(angle_rad), np.sin(angle_rad)], -1)
    judge, seen = MeetingJudge(heading), []
    setting = Setting(episodes=len(heading), episodes_seed=seed)

    def watch(world: Scenario, _running: Flags) -> None:
        seen.append(motion(world)[0])

    play(head_on(heading), make_decide, judge, setting, NAVIGATION.steps, seed, watch)
    return judge.meetings(), np.stack(seen)


def head_on(heading: Floats) -> Navigation:
    """Set the scene for robot 0 to drive along headings (E, 2)."""
    left = _left_of(heading)
    world = Navigation(len(heading), 0, torch.device("cpu"), training=False)
    starts = [-HALF_WAY_M * heading, HALF_WAY_M * heading, PARKED_M * left, -PARKED_M * left]
    goals = [starts[1], starts[0], *starts[2:]]
    state = world.state_dict()
    state["position"] = torch.from_numpy(np.stack(starts, 1)).float()
    state["goal"] = torch.from_numpy(np.stack(goals, 1)).float()
    state["velocity"] = torch.zeros_like(state["position"])
    world.load_state_dict(state)
    return world


def _left_of(heading: Floats) -> Floats:
    return np.stack([-heading[:, 1], heading[:, 0]], -1)
