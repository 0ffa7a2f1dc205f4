"""Observations of B robots against VMAS's own navigation scenario."""

import numpy as np
import pytest
from bundles import MANIFEST
from observation_scenes import ROBOTS, scenes, vmas_observations

from export.evaluation.observation import observe_batch
from export.evaluation.outlook import TeamBatch


def team_batch(position, velocity, robot):
    mates = [i for i in range(ROBOTS) if i != robot]
    ids = np.broadcast_to(mates, (len(position), ROBOTS - 1))
    return TeamBatch(
        np.full(len(position), robot),
        position[:, robot],
        velocity[:, robot],
        ids,
        position[:, mates],
        velocity[:, mates],
        np.zeros((len(position), ROBOTS - 1, 2)),
    )


@pytest.mark.parametrize("robot", range(ROBOTS))
def test_batched_observation_is_vmas(robot):
    position, velocity, goal = scenes()
    found = observe_batch(MANIFEST, team_batch(position, velocity, robot), goal[:, robot])
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, vmas_observations()[robot], atol=1e-6)


def test_a_non_finite_teammate_spoils_only_its_own_row():
    position, velocity, goal = (array.copy() for array in scenes())
    position[7, 1] = np.nan
    found = observe_batch(MANIFEST, team_batch(position, velocity, 0), goal[:, 0])
    assert not np.isfinite(found[7]).all()
    assert np.isfinite(np.delete(found, 7, 0)).all()
