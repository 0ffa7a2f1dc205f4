"""Eased ranges for many robots against what one robot observes."""

import numpy as np
import pytest
from bundles import MANIFEST
from msgspec.structs import replace

from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.observation import Ranges
from edge_runtime.observation.observer import Observer
from export.episodes.ease import eased

PLAIN = replace(MANIFEST, observation=(*MANIFEST.observation[:3], Ranges("ranges", 12, "m")))


def watching(seen):
    return lambda _batch: lambda observation, *_: seen.append(observation)


@pytest.mark.parametrize("manifest", [MANIFEST, PLAIN], ids=["proximity", "ranges"])
def test_many_robots_see_as_eased_as_one(manifest):
    observer, seen = Observer(manifest, (0.5, 0.0)), []
    own = RobotState(0, 0.0, (0.1, 0.2), (0.1, 0.0))
    places = [(0.4, 0.2), (0.35, 0.45), (-0.2, 0.2), (0.15, 0.25)]
    teams = [TeamState(own, (Teammate(RobotState(1, 0.0, place, (0.0, 0.0))),)) for place in places]
    as_they_are = np.concatenate([observer.observe(team).copy() for team in teams])
    one_by_one = np.concatenate([observer.observe(team, ease_m=0.1).copy() for team in teams])
    eased(watching(seen), manifest, 0.1)(len(teams))(as_they_are, None, None)
    np.testing.assert_allclose(seen[0], one_by_one, atol=1e-6)
    assert not np.array_equal(seen[0], as_they_are)


def test_nothing_to_ease_is_the_same_decision():
    decide = watching([])
    assert eased(decide, MANIFEST, 0.0) is decide
