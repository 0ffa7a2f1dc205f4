"""What many robots know of their load's way to its goal against what one robot is told."""

import numpy as np
from bundles import MANIFEST
from msgspec.structs import replace

from edge_runtime.messages import RobotState, TeamState, TrackedObject
from edge_runtime.observation import TrackedGoalOffset
from edge_runtime.observation.observer import Observer
from export.episodes.carried import carrying
from export.evaluation.outlook import TeamBatch

CARRYING = replace(
    MANIFEST,
    observation=(
        MANIFEST.observation[0],
        *(TrackedGoalOffset(f"{name}_goal_offset", 2, "m", object=name) for name in ("box", "lid")),
    ),
)


def test_the_object_that_is_farthest_from_its_goal_counts():
    draw, seen = np.random.default_rng(0), []
    views = TeamBatch.of_teams(*draw.uniform(-1, 1, (3, 1, 8, 2)))
    observer, own = Observer(CARRYING, (0.0, 0.0)), RobotState(0, 0.0, (0.1, 0.2), (0.0, 0.0))
    observations, expected = [], []
    for places in draw.uniform(-1, 1, (8, 2, 2, 2)):
        tracked = tuple(
            TrackedObject(name, 0.0, tuple(place), (0.0, 0.0), goal_m=tuple(goal))
            for name, (place, goal) in zip(("box", "lid"), places.tolist(), strict=True)
        )
        observations.append(observer.observe(TeamState(own, tracked=tracked)).copy())
        expected.append(np.linalg.norm(places[:, 0] - places[:, 1], axis=-1).max())
    decide = carrying(lambda _: lambda _, views, __: seen.append(views), CARRYING)(8)
    decide(np.concatenate(observations), views, draw)
    np.testing.assert_allclose(seen[0].left_m, expected, rtol=1e-5)


def test_without_goals_nothing_is_known():
    def decide(_batch):
        raise AssertionError

    assert carrying(decide, MANIFEST) is decide
