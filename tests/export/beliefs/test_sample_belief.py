"""A robot's belief of the field: right where it has read, usual elsewhere, empty where anybody was."""

import numpy as np
import pytest
import torch

from edge_runtime.messages import Reading, RobotState, Teammate, TeamState
from export.beliefs.field_guesses import HALF_WIDTH_M
from export.beliefs.sample_belief import (
    AROUND_M,
    CELL_M,
    CELLS,
    Richest,
    SampleBelief,
)
from export.scenarios import make_scenario

TEAMS = 6
CELL = (np.arange(CELLS) + 0.5) * CELL_M - HALF_WIDTH_M


def truth(world):
    """What is left in each cell, at its middle (E, 40, 40)."""
    state = world.state_dict()
    centre, densest = state["centre"].double().numpy(), state["densest"].double().numpy()
    along = np.exp(-np.square(CELL[:, None, None, None] - centre) / 0.1)
    density = np.einsum("xek,yek->exy", along[..., 0], along[..., 1]) / densest[:, None, None]
    return np.where(state["emptied"].numpy().reshape(density.shape), 0.0, density)


@pytest.fixture(scope="module")
def wandered():
    """A world whose teams have wandered about, and what each robot then believes."""
    world = make_scenario("sampling", TEAMS, 3, torch.device("cpu"), training=False)
    draw, belief, action = np.random.default_rng(0), SampleBelief(3 * TEAMS), np.zeros((TEAMS, 3, 2))
    for _ in range(60):
        position = world.motion()[0].double().numpy()
        others = np.stack([np.delete(position, own, 1) for own in range(3)], 1)
        belief.follow(position.reshape(-1, 2), others.reshape(-1, 2, 2), readings(world))
        action = 0.8 * action + draw.normal(size=action.shape)
        world.step(torch.from_numpy(action).float())
    return world, belief, position


def readings(world):
    return world.observe().flatten(0, 1).numpy()[:, -8:]


def test_what_a_robot_has_read_it_knows(wandered):
    world, belief, position = wandered
    left, density = belief.left().reshape(TEAMS, 3, CELLS, CELLS), truth(world)
    cells = np.stack(np.meshgrid(CELL, CELL, indexing="ij"), -1)
    near = np.linalg.norm(cells - position[..., None, None, :], axis=-1) < 0.15
    density = np.broadcast_to(density[:, None], left.shape)
    error = np.abs(left - density)[near]
    assert np.median(error) < 0.02
    assert error.mean() < 0.2 * np.abs(density.mean() - density)[near].mean()


def test_where_anybody_of_the_team_was_nothing_is_left(wandered):
    _world, belief, position = wandered
    cell = ((position + HALF_WIDTH_M) / CELL_M).astype(int).clip(0, CELLS - 1)
    left = belief.left().reshape(TEAMS, 3, CELLS, CELLS)
    for team in range(TEAMS):
        for x, y in cell[team]:
            assert not left[team, :, x, y].any()


def test_a_robot_is_drawn_to_the_richer_side_of_what_it_reads():
    """A bump to the east, read from its slope: not to the west, of which nothing is known."""
    belief, own, centre = SampleBelief(1), np.zeros((1, 2)), np.array([0.45, 0.0])
    for _ in range(5):
        seen = np.exp(-np.square(own[:, None] + AROUND_M - centre).sum(-1) / 0.1)
        there = belief.follow(own, np.zeros((1, 0, 2)), seen)
    assert there[0, 0] > 0.2
    assert abs(there[0, 1]) < 0.2


def test_a_robot_believes_on_its_own_computer_what_it_does_in_an_evaluation():
    draw, zone = np.random.default_rng(1), (0.1, 0.2, 0.3)
    many, ones = SampleBelief(4, [zone]), [Richest(closed=[zone]) for _ in range(4)]
    for tick in range(8):
        place = draw.uniform(-0.9, 0.9, (4, 3, 2))
        readings = draw.uniform(0.0, 0.5, (4, 8)).astype(np.float32)
        expected = many.follow(place[:, 0], place[:, 1:], readings)
        for robot, one in enumerate(ones):
            own, *mates = (
                RobotState(n, 0.1 * tick, tuple(at), (0.0, 0.0)) for n, at in enumerate(place[robot].tolist())
            )
            read = (Reading("nearby_samples", tuple(readings[robot].tolist())),)
            team = TeamState(own, tuple(map(Teammate, mates)), readings=read)
            np.testing.assert_allclose(one.follow(team), expected[robot])
    assert Richest().follow(TeamState(own)) is None


def test_nothing_is_to_be_gathered_where_nobody_may_go():
    left = SampleBelief(1, [(0.1, 0.2, 0.3)]).left()[0]
    inside = np.hypot(CELL[:, None] - 0.1, CELL - 0.2) < 0.3
    assert not left[inside].any()
    assert left[~inside].all()
