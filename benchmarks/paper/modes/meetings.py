"""Two robots that meet head-on, and the sides on which they pass: whether a policy has more than one way.

VMAS Navigation: robots 0 and 1 change places along a line, the other two stand on goals of their own, far
from it. Every episode of a scene starts in the very same state; only the flow's start noise differs.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from benchmarks.paper.episodes import MakeDecide
from benchmarks.paper.judges import motion
from benchmarks.paper.neighbourhood import Neighbourhood
from edge_runtime.common.arrays import Floats
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import FACTS, Navigation

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
    collided: npt.NDArray[np.bool_]
    """(E,): robots touched before they had arrived."""


class MeetingJudge:
    """Follows E meetings.

    Args:
        heading: (E, 2), unit vectors in which robot 0 drives; robot 1 comes from there.
    """

    def __init__(self, heading: Floats) -> None:
        episodes = len(heading)
        self._heading, self._left = heading, np.stack([-heading[:, 1], heading[:, 0]], -1)
        self._side, self._collided = np.zeros(episodes, np.int64), np.zeros(episodes, bool)
        self._arrival, self._steps = np.full(episodes, np.inf), 0

    def add(self, position: Floats, arrived: npt.NDArray[np.bool_], touching: npt.NDArray[np.bool_]) -> None:
        """Take one step: positions (E, N, 2); all on their goals (E,), any two in contact (E,).

        They pass in the step in which robot 0 gets ahead of robot 1, on the side on which it then is.
        """
        self._steps += 1
        apart = position[:, 0] - position[:, 1]
        ahead, left = (apart * self._heading).sum(-1), (apart * self._left).sum(-1)
        passing = (self._side == 0) & (ahead > 0.0)
        self._side[passing] = np.where(left > 0.0, 1, -1)[passing]
        self._collided |= touching & np.isinf(self._arrival)
        self._arrival[arrived & np.isinf(self._arrival)] = self._steps

    def meetings(self) -> Meetings:
        """Return what was followed."""
        return Meetings(self._side, self._arrival, self._collided)


def meet(
    make_decide: MakeDecide,
    angle_rad: Floats,
    seed: int,
    watch: Callable[[Floats], None] = lambda _: None,
) -> Meetings:
    """Run E meetings, robot 0 driving in directions (E,); the seed is of the noise.

    ``watch`` is called with the positions (E, N, 2) before every step.
    """
    heading = np.stack([np.cos(angle_rad), np.sin(angle_rad)], -1)
    world = head_on(heading)
    episodes, robots, draw = len(heading), FACTS.robots, np.random.default_rng(seed)
    decide, judge = make_decide(episodes * robots), MeetingJudge(heading)
    neighbourhood = Neighbourhood(episodes, robots, None, 0.0, draw)
    action = np.zeros((episodes, robots, 2))
    for _ in range(NAVIGATION.steps):
        position, velocity = motion(world)
        watch(position)
        views = neighbourhood.views(position, velocity, action)
        observation = world.observe().flatten(0, 1).numpy()
        action = np.clip(decide(observation, views, draw), -1.0, 1.0).reshape(episodes, robots, 2)
        transition = world.step(torch.from_numpy(action).float())
        judge.add(motion(world)[0], transition.succeeded.numpy(), transition.failed.numpy())
    return judge.meetings()


def head_on(heading: Floats) -> Navigation:
    """Set the scene for robot 0 to drive along headings (E, 2)."""
    left = np.stack([-heading[:, 1], heading[:, 0]], -1)
    world = Navigation(len(heading), 0, torch.device("cpu"), training=False)
    starts = [-HALF_WAY_M * heading, HALF_WAY_M * heading, PARKED_M * left, -PARKED_M * left]
    goals = [starts[1], starts[0], *starts[2:]]
    state = world.state_dict()
    state["position"] = torch.from_numpy(np.stack(starts, 1)).float()
    state["goal"] = torch.from_numpy(np.stack(goals, 1)).float()
    state["velocity"] = torch.zeros_like(state["position"])
    world.load_state_dict(state)
    return world
