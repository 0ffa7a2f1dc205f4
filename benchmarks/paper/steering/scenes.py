"""Scenes of Navigation whose objectives are many, truly conflict, or choose between ways round something."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from edge_runtime.common.arrays import Floats
from edge_runtime.objectives import (
    Clustering,
    Geofence,
    Objective,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
)
from export.scenarios.navigation import Navigation

SPEED, MARGIN = SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)
POSTS = tuple(Geofence(centre_m=place, radius_m=0.15) for place in ((0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5)))
"""Four zones around the middle, half a metre from it."""
CLEAR_M = 0.1
"""Between a zone and every start and goal: they can be reached without entering it."""
TOGETHER = (Clustering(radius_m=0.2), Spacing(distance_m=0.3))
"""What cannot be had with a margin of 0.35 m, the one nor the other, nor with goals all over the arena."""
WALL = tuple(Geofence(centre_m=(0.0, y), radius_m=0.25) for y in (0.0, 0.4))
"""A zone on the straight way, and one north of it: the way south about is free, and the shorter."""
HALF_WAY_M, PARKED_M, ASIDE_M = 0.6, 0.95, 0.1


@dataclass(frozen=True)
class Scene:
    """Four robots, and what is asked of them."""

    title: str
    objectives: tuple[Objective, ...]
    start: Callable[[int, int], Navigation]
    """Makes E episodes from a seed."""
    kept: tuple[int, ...]
    """Which of the objectives must be kept for success; the others are wishes against them."""
    on_the_right: bool = False
    """Whether robots 0 and 1 must pass each other on their right."""
    chooses: bool = False
    """Whether an objective chooses between ways round something."""


def anywhere(episodes: int, seed: int) -> Navigation:
    """The task's own starts, those left out that have a start or goal near a post."""
    pool = Navigation(12 * episodes, seed, torch.device("cpu"), training=False).state_dict()
    places = torch.cat([pool["position"], pool["goal"]], 1)
    centre = torch.tensor([post.centre_m for post in POSTS])
    near = (places[:, :, None] - centre).norm(dim=-1) < POSTS[0].radius_m + CLEAR_M
    rows = (~near.any(2).any(1)).nonzero()[:episodes, 0]
    return _placed(pool["position"][rows].numpy(), pool["goal"][rows].numpy())


def past_the_wall(episodes: int, seed: int) -> Navigation:
    """Robot 0 wants to the other side of the wall; the others stand in the corners."""
    draw = np.random.default_rng(seed)
    start = np.stack([np.full(episodes, -HALF_WAY_M), draw.uniform(-ASIDE_M, ASIDE_M, episodes)], -1)
    corners = PARKED_M * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
    parked = np.broadcast_to(corners, (episodes, 3, 2))
    goal = np.array([-1.0, 1.0]) * start
    return _placed(*(np.concatenate([own[:, None], parked], 1) for own in (start, goal)))


def head_on(episodes: int, seed: int) -> Navigation:
    """Robots 0 and 1 change places along y; the others stand beside, out of sight."""
    aside = np.random.default_rng(seed).uniform(-0.02, 0.02, episodes)
    south = np.stack([aside, np.full(episodes, -HALF_WAY_M)], -1)
    parked = np.broadcast_to(PARKED_M * np.array([[1.0, 0.0], [-1.0, 0.0]]), (episodes, 2, 2))
    ends = [south[:, None], -south[:, None]]
    return _placed(np.concatenate([*ends, parked], 1), np.concatenate([*ends[::-1], parked], 1))


def _placed(position: Floats, goal: Floats) -> Navigation:
    world = Navigation(len(position), 0, torch.device("cpu"), training=False)
    state = world.state_dict()
    state["position"], state["goal"] = (torch.from_numpy(places).float() for places in (position, goal))
    state["velocity"] = torch.zeros_like(state["position"])
    world.load_state_dict(state)
    return world


SCENES = {
    "two": Scene("M = 2: speed limit, margin", (SPEED, MARGIN), anywhere, (0, 1)),
    "six": Scene("M = 6: and four zones", (SPEED, MARGIN, *POSTS), anywhere, tuple(range(6))),
    "eight": Scene(
        "M = 8: and a margin of 0.35 m against a cluster of 0.2 m and a spacing of 0.3 m",
        (SPEED, SafetyMargin(distance_m=0.35), *POSTS, *TOGETHER),
        anywhere,
        tuple(range(6)),
    ),
    "wall": Scene(
        "M = 4: round a zone, south about",
        (SPEED, MARGIN, *WALL),
        past_the_wall,
        tuple(range(4)),
        chooses=True,
    ),
    "meeting": Scene(
        "M = 3: head-on, to pass on the right",
        (SPEED, MARGIN, SpatialOrder(order=(1, 0), gap_m=0.2)),
        head_on,
        (0, 1),
        on_the_right=True,
        chooses=True,
    ),
}
