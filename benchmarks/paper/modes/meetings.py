"""Two robots that meet head-on, and the sides on which they pass: whether a policy has more than one way.

VMAS Navigation: robots 0 and 1 change places along a line, the other two stand on goals of their own, far
from it. Every episode of a scene starts in the very same state; only the flow's start noise differs.
"""

import numpy as np
import numpy.typing as npt
import torch

from edge_runtime.common.arrays import Floats
from export.episodes.judges import motion
from export.episodes.neighbourhood import Setting
from export.episodes.play import MakeDecide, play
from export.scenarios.definitions import NAVIGATION
from export.scenarios.navigation import Navigation
from export.scenarios.scenario import Scenario, Transition

HALF_WAY_M = 0.6
PARKED_M = 0.95
"""How far from the middle the other two stand, beyond everybody's sensor."""


class _Recorder:
    """Follows E episodes to the end of their time."""

    def __init__(self, episodes: int) -> None:
        self.running = np.ones(episodes, bool)
        self.positions: list[Floats] = []

    def add(self, world: Scenario, _transition: Transition) -> None:
        self.positions.append(motion(world)[0])


def meet(make_decide: MakeDecide, angle_rad: Floats, seed: int) -> Floats:
    """Run E meetings, robot 0 driving in directions (E,); the seed is of the noise.

    Returns:
        All positions (S, E, N, 2) after each step.
    """
    heading, recorder = np.stack([np.cos(angle_rad), np.sin(angle_rad)], -1), _Recorder(len(angle_rad))
    setting = Setting(episodes=len(heading), episodes_seed=seed)
    play(head_on(heading), make_decide, recorder, setting, NAVIGATION.steps, seed)
    return np.stack(recorder.positions)


def along(tracks: Floats, angle_rad: Floats) -> Floats:
    """Turn tracks (S, E, N, 2) so that headings (E,) point along x."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned: Floats = np.einsum("ije,senj->seni", np.array([[cos, sin], [-sin, cos]]), tracks)
    return turned


def sides(tracks: Floats) -> npt.NDArray[np.int64]:
    """Of meetings along x (S, E, N, 2): (E,), 1 where both kept to their left, -1 to their right.

    0 where they never passed; they pass where robot 0 gets ahead of robot 1, on the side on which it then is.
    """
    ahead, left = np.moveaxis(tracks[:, :, 0] - tracks[:, :, 1] > 0.0, -1, 0)
    there = left[ahead.argmax(0), np.arange(left.shape[1])]
    return np.where(ahead.any(0), np.where(there, 1, -1), 0)


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
