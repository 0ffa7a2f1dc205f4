"""Random teams, and what VMAS's own navigation scenario has their robots observe."""

import functools

import numpy as np
import pytest

TEAMS, ROBOTS = 400, 4


@functools.cache
def scenes():
    """Positions, velocities and goals (B, N, 2), from spread out to so near that discs overlap."""
    draw = np.random.default_rng(3)
    spread = draw.uniform(0.02, 0.8, (TEAMS, 1, 1))
    position = spread * draw.uniform(-1, 1, (TEAMS, ROBOTS, 2))
    return position, draw.standard_normal((TEAMS, ROBOTS, 2)), draw.uniform(-1, 1, (TEAMS, ROBOTS, 2))


@functools.cache
def vmas_observations():
    """VMAS's observations (N, B, 18) in double precision, for a grazing ray magnifies rounding."""
    torch, vmas = pytest.importorskip("torch"), pytest.importorskip("vmas")
    position, velocity, goal = (torch.from_numpy(array) for array in scenes())
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
