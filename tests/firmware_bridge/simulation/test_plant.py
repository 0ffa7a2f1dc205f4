"""The plant against VMAS navigation, step by step and through collisions."""

import math

import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given
from motion_models import moving
from msgspec.structs import replace

from edge_runtime.config.fleet import Obstacle
from edge_runtime.motion.models import LinearTable, PointAcceleration, PointForce, Unicycle, VelocityLag
from firmware_bridge.simulation.plant import Plant, contact_forces

RADIUS_M = MANIFEST.body.radius_m
MODELS = [
    PointForce(2.0, 0.1, 0.05, substeps=3, dims=3),
    PointAcceleration(0.05, drag=0.1, angular=True),
    VelocityLag(0.05, 0.2),
    Unicycle(0.05),
    LinearTable(0.05, (0.9, 0.9), ((0.1,), (0.0,)), (0.05, 0.05), ((0.0,), (0.0,))),
]


@pytest.mark.parametrize("robots", [1, 2, 4])
def test_every_step_is_vmas(robots):
    """Teams start partly overlapping and push towards each other: each step from VMAS's own state."""
    torch, vmas = pytest.importorskip("torch"), pytest.importorskip("vmas")
    teams, draw = 24, np.random.default_rng(robots)
    env = vmas.make_env(
        "navigation", num_envs=teams, device="cpu", seed=0, n_agents=robots, clamp_actions=True
    )
    position = 0.25 * draw.uniform(-1, 1, (teams, robots, 2))
    for i, agent in enumerate(env.agents):
        agent.state.pos = torch.tensor(position[:, i], dtype=torch.float32)
    touching = 0
    for _ in range(40):
        before = np.stack([agent.state.pos.numpy() for agent in env.agents], 1)
        plants = [Plant(MANIFEST.motion, RADIUS_M, places) for places in before]
        for plant, speeds in zip(
            plants, np.stack([agent.state.vel.numpy() for agent in env.agents], 1), strict=True
        ):
            plant.velocity_m_s[:] = speeds
        touching += int((contact_forces(before, RADIUS_M) != 0).any((1, 2)).sum())
        force = np.clip(-3 * before + draw.standard_normal(before.shape), -1, 1).astype(np.float32)
        env.step([torch.from_numpy(force[:, i].copy()) for i in range(robots)])
        for plant, forces in zip(plants, force.tolist(), strict=True):
            plant.step(forces)
        after = np.stack([agent.state.pos.numpy() for agent in env.agents], 1)
        velocity = np.stack([agent.state.vel.numpy() for agent in env.agents], 1)
        np.testing.assert_allclose([plant.position_m for plant in plants], after, atol=1e-5)
        np.testing.assert_allclose([plant.velocity_m_s for plant in plants], velocity, atol=1e-5)
    assert touching > 75 or robots == 1


def test_contact_keeps_momentum():
    position = np.random.default_rng(0).uniform(-0.2, 0.2, (10, 5, 2))
    force = contact_forces(position, RADIUS_M)
    assert np.abs(force).max() > 1.0
    np.testing.assert_allclose(force.sum(1), 0.0, atol=1e-10)


def test_one_second_is_one_second_at_any_period():
    """Without contact, a finer period coasts to the same speed."""
    plants = [Plant(MANIFEST.motion.at_period(period), RADIUS_M, [[0.0, 0.0]]) for period in (0.1, 0.02)]
    for plant in plants:
        plant.velocity_m_s[:] = 1.0
        for _ in range(round(1.0 / plant.motions[0].dt_s)):
            plant.step([[0.0, 0.0]])
    np.testing.assert_allclose(plants[0].velocity_m_s, plants[1].velocity_m_s, rtol=1e-9)


def test_an_obstacle_pushes_as_a_robot_does_and_is_not_pushed():
    """The force on a robot is the same, whatever stands in its way; both touches are told."""
    between = Plant(MANIFEST.motion, RADIUS_M, [[0.0, 0.0], [0.15, 0.1]])
    at_once = replace(MANIFEST.motion, substeps=1)
    before = Plant(at_once, RADIUS_M, [[0.0, 0.0]], [Obstacle((0.15, 0.1), RADIUS_M)])
    force = contact_forces(between.position_m, RADIUS_M)[0]
    before.step([[0.0, 0.0]])
    np.testing.assert_allclose(before.velocity_m_s[0], 0.1 * force)
    assert before.obstacles() == [(0.15, 0.1, RADIUS_M)]
    between.step(np.zeros((2, 2)))
    assert before.touched == between.touched == {(0, 1)}


def test_an_obstacle_walks_on_and_what_is_free_of_it_is_not_touched():
    plant = Plant(MANIFEST.motion, RADIUS_M, [[0.0, 0.0]], [Obstacle((1.0, 0.0), 0.2, (0.0, -0.5))])
    for _ in range(20):
        plant.step([[0.0, 0.0]])
    np.testing.assert_allclose(plant.obstacle_m, [[1.0, -1.0]])
    assert not plant.touched
    assert not plant.position_m.any()


@given(moving())
def test_without_contact_a_step_is_the_models_prediction(case):
    """In the plane and in space, turning or not, with any number of substeps."""
    model, start, action = case
    plant = Plant(model, 0.1, [start.position_m], heading_rad=start.heading_rad)
    plant.velocity_m_s[0], plant.yaw_rate_rad_s[0] = start.velocity_m_s, start.yaw_rate_rad_s
    plant.step([action])
    moved, now = model.predict(start, action), plant.state(0, 0, 0.0)
    assert now.position_m == pytest.approx(moved.position_m(model.dims), abs=1e-9)
    assert now.velocity_m_s == pytest.approx(moved.velocity_m_s(model.dims), abs=1e-9)
    if model.turns:
        assert now.yaw_rate_rad_s == pytest.approx(moved.yaw_rate, abs=1e-9)
        assert math.remainder(now.heading_rad - moved.heading, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_whatever_moves_robots_they_push_each_other_apart(model):
    apart = np.array([0.15, *[0.02] * (model.dims - 1)])
    plant = Plant(model, 0.1, [0.0 * apart, apart])
    for _ in range(40):
        plant.step([(0.0,) * model.action_dim] * 2)
    assert plant.touched == {(0, 1)}
    assert np.linalg.norm(np.subtract(*plant.position_m)) > 0.195
    assert np.isfinite(plant.position_m).all()
