"""Places on the border for many robots against what one robot observes."""

import numpy as np
from bundles import MANIFEST

from edge_runtime.messages import RobotState, TeamState
from edge_runtime.observation.border import Arena, Border
from edge_runtime.observation.observer import Observer
from export.episodes.bordered import bordered

ARENA = Arena((-1.0, -0.5), (1.0, 2.0))


def watching(seen):
    return lambda _batch: lambda observation, *_: seen.append(observation)


def test_many_robots_observe_their_places_as_one_does():
    observer, border, seen = Observer(MANIFEST, (0.5, 0.0)), Border(MANIFEST.observation, ARENA), []
    places = [(0.4, 0.2), (3.0, 0.4), (-2.0, -2.0), (0.1, 2.5)]
    teams = [TeamState(RobotState(0, 0.0, place, (0.1, 0.0))) for place in places]
    as_they_are = np.concatenate([observer.observe(team).copy() for team in teams])
    one_by_one = []
    for team in teams:
        border.clamp(found := observer.observe(team))
        one_by_one.append(found.copy())
    before = as_they_are.copy()
    bordered(watching(seen), MANIFEST, ARENA)(len(teams))(as_they_are, None, None)
    np.testing.assert_array_equal(seen[0], np.concatenate(one_by_one))
    np.testing.assert_array_equal(as_they_are, before)
    assert not np.array_equal(seen[0], before)


def test_without_an_arena_it_is_the_same_decision():
    decide = watching([])
    assert bordered(decide, MANIFEST, None) is decide
