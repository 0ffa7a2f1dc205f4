"""The observation against VMAS's own navigation scenario, and its two forms against each other."""

import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.errors import PolicyError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.outlook import TeamBatch
from edge_runtime.observation.observer import Observer, disc_ranges, observe_batch, ray_directions
from edge_runtime.policy.manifest import ObservationField

TEAMS, ROBOTS = 400, 4


def team_state(position, velocity, robot):
    states = [
        RobotState(i, 0.0, tuple(p), tuple(v))
        for i, (p, v) in enumerate(zip(position.tolist(), velocity.tolist(), strict=True))
    ]
    return TeamState(states[robot], tuple(Teammate(s) for i, s in enumerate(states) if i != robot))


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


@pytest.fixture(scope="module")
def scenes():
    """Random teams, from spread out to so near that discs overlap and centres nearly meet."""
    draw = np.random.default_rng(3)
    spread = draw.uniform(0.02, 0.8, (TEAMS, 1, 1))
    position = spread * draw.uniform(-1, 1, (TEAMS, ROBOTS, 2))
    return position, draw.standard_normal((TEAMS, ROBOTS, 2)), draw.uniform(-1, 1, (TEAMS, ROBOTS, 2))


@pytest.fixture(scope="module")
def reference(scenes):
    """VMAS's observations (N, B, 18) in double precision, for a grazing ray magnifies rounding."""
    torch, vmas = pytest.importorskip("torch"), pytest.importorskip("vmas")
    position, velocity, goal = (torch.from_numpy(array) for array in scenes)
    env = vmas.make_env("navigation", num_envs=TEAMS, device="cpu", seed=0, n_agents=ROBOTS)
    for i, agent in enumerate(env.agents):
        agent.state.pos, agent.state.vel = position[:, i], velocity[:, i]
        agent.state.rot = agent.state.rot.double()
        agent.goal.state.pos = goal[:, i]
    torch.set_default_dtype(torch.float64)
    try:
        for agent in env.agents:
            (sensor,) = agent.sensors
            sensor._angles = torch.linspace(0, 2 * torch.pi, 13)[:12].repeat(TEAMS, 1)
        return np.stack([env.scenario.observation(agent).numpy() for agent in env.agents])
    finally:
        torch.set_default_dtype(torch.float32)


@pytest.mark.parametrize("robot", range(ROBOTS))
def test_single_observation_is_vmas(scenes, reference, robot):
    position, velocity, goal = scenes
    for row in range(TEAMS):
        observer = Observer(MANIFEST, tuple(goal[row, robot].tolist()))
        found = observer.observe(team_state(position[row], velocity[row], robot))
        np.testing.assert_allclose(found[0], reference[robot, row], atol=1e-6)


@pytest.mark.parametrize("robot", range(ROBOTS))
def test_batched_observation_is_vmas(scenes, reference, robot):
    position, velocity, goal = scenes
    found = observe_batch(MANIFEST, team_batch(position, velocity, robot), goal[:, robot])
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, reference[robot], atol=1e-6)


def test_scenes_reach_into_discs(reference):
    """The scenes above do contain rays that start inside a disc, and free ones."""
    proximity = reference[..., 6:]
    assert (proximity > MANIFEST.body.lidar_range_m).sum() > 50
    assert (proximity == 0).sum() > 50


def test_fields_follow_the_manifest():
    fields = (ObservationField("goal_offset", 2, "m"), ObservationField("position", 2, "m"))
    observer = Observer(replace(MANIFEST, observation=fields), (1.0, 2.0))
    own = RobotState(0, 0.0, (0.25, 0.5), (0.0, 0.0))
    np.testing.assert_array_equal(observer.observe(TeamState(own)), [[-0.75, -1.5, 0.25, 0.5]])


def test_a_field_without_a_source_is_refused():
    fields = (ObservationField("position", 2, "m"), ObservationField("nearby_samples", 8, "1"))
    with pytest.raises(PolicyError, match="observes nearby_samples, for which robots have no source yet"):
        Observer(replace(MANIFEST, observation=fields), (0.0, 0.0))


def test_a_real_sensor_takes_the_place_of_the_computed_one():
    observer = Observer(MANIFEST, (0.0, 0.0))
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0)))
    found = observer.observe(replace(team, ranges_m=(0.1,) * 12))
    np.testing.assert_allclose(found[0, 6:], 0.25, atol=1e-7)
    with pytest.raises(PolicyError, match="got 3 ranges, the policy's sensor has 12 rays"):
        observer.observe(replace(team, ranges_m=(0.1,) * 3))


@given(
    x=st.floats(-1, 1),
    y=st.floats(-1, 1),
    discs=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), max_size=6),
)
@settings(max_examples=100, deadline=None)
def test_readings_never_exceed_the_range_nor_depend_on_the_order(x, y, discs):
    rays = [tuple(ray) for ray in ray_directions(MANIFEST.body).tolist()]
    found = disc_ranges((x, y), discs, rays, MANIFEST.body)
    assert found == disc_ranges((x, y), discs[::-1], rays, MANIFEST.body)
    assert all(-MANIFEST.body.radius_m <= reading <= MANIFEST.body.lidar_range_m for reading in found)


def test_a_non_finite_teammate_spoils_only_its_own_row(scenes):
    position, velocity, goal = (array.copy() for array in scenes)
    position[7, 1] = np.nan
    found = observe_batch(MANIFEST, team_batch(position, velocity, 0), goal[:, 0])
    assert not np.isfinite(found[7]).all()
    assert np.isfinite(np.delete(found, 7, 0)).all()
