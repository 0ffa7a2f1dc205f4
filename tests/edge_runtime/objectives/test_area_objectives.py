"""Geofence and clustering: against autograd, the action that cures them, and where they degenerate."""

import math

import numpy as np
import pytest
import torch
from literal_dynamics import drive

from edge_runtime.config.objectives import load_objective_set
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import Clustering, Geofence, Slope
from edge_runtime.objectives.gradient_check import check_gradient

DYNAMICS = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1)
FENCE = Geofence(centre_m=(0.1, -0.05), radius_m=0.3)
CLUSTER = Clustering(radius_m=0.3)


def tensor(values):
    return torch.tensor(values, dtype=torch.float64)


def position_after(state, action, look_ahead_steps):
    position, _ = drive(
        tensor(state.position_m), tensor(state.velocity_m_s), action, DYNAMICS, look_ahead_steps
    )
    return position


def gain(steps):
    return DYNAMICS.preview(steps).position_gain


def fence_cost(fence, team, action):
    offset = position_after(team.own, action, fence.look_ahead) - tensor(fence.centre_m)
    depth = (fence.radius_m + fence.buffer_m - offset.norm()).clamp_min(0)
    return 0.5 * (depth / gain(fence.look_ahead)) ** 2


def cluster_cost(cluster, team, action):
    places = [position_after(team.own, action, cluster.look_ahead)]
    for mate in team.teammates:
        places.append(position_after(mate.state, tensor(mate.intended_action), cluster.look_ahead))
    places = torch.stack(places)
    radius = (places - places.mean(0)).norm(dim=1).mean()
    return 0.5 * ((radius - cluster.radius_m) / gain(cluster.look_ahead)) ** 2


def team_at(*positions, own=0):
    """Robots at rest, seen by robot ``own``."""
    states = [RobotState(i, 0.0, position, (0.0, 0.0)) for i, position in enumerate(positions)]
    mates = tuple(Teammate(state) for state in states if state.robot_id != own)
    return TeamState(states[own], mates)


def random_team(seed, mates=2):
    draw = np.random.default_rng(seed)

    def state(robot):
        position, velocity = draw.uniform(-0.3, 0.3, (2, 2)).tolist()
        return RobotState(robot, 0.0, tuple(position), tuple(velocity))

    teammates = [Teammate(state(k), tuple(draw.uniform(-1, 1, 2).tolist())) for k in range(1, mates + 1)]
    return TeamState(state(0), tuple(teammates))


def slope(objective, team):
    outlook = look_ahead(team, DYNAMICS.preview(objective.look_ahead))
    return objective.evaluate(outlook.drift, outlook)


@pytest.mark.parametrize(
    "objective",
    [FENCE, Geofence(centre_m=(0.0, 0.0), radius_m=0.05, look_ahead=1), CLUSTER, Clustering(radius_m=0.05)],
    ids=lambda o: f"{o.name}-{o.radius_m}",
)
@pytest.mark.parametrize("teammates", [1, 2, 5])
def test_gradients(objective, teammates):
    assert check_gradient(objective, DYNAMICS, teammates=teammates, motions=2000).active > 20


@pytest.mark.parametrize(("objective", "cost_of"), [(FENCE, fence_cost), (CLUSTER, cluster_cost)])
@pytest.mark.parametrize("seed", range(20))
def test_cost_and_pull_back_are_autograds(objective, cost_of, seed):
    team, action = random_team(seed), tensor([0.0, 0.0]).requires_grad_()
    cost = cost_of(objective, team, action)
    (wanted,) = torch.autograd.grad(cost, action)
    found = slope(objective, team)
    assert found.cost == pytest.approx(cost.item(), abs=1e-9)
    pulled = np.array([found.d_x, found.d_y]) * gain(objective.look_ahead)
    np.testing.assert_allclose(pulled, wanted.numpy(), atol=1e-9)


def test_the_fences_descent_step_is_the_cure():
    team = team_at((0.2, 0.0))
    found = slope(FENCE, team)
    step = -gain(4) * tensor([found.d_x, found.d_y])
    offset = position_after(team.own, step, 4) - tensor(FENCE.centre_m)
    assert offset.norm().item() == pytest.approx(FENCE.radius_m + FENCE.buffer_m)
    assert found.cost == pytest.approx(0.5 * step.square().sum().item())


@pytest.mark.parametrize("side", [0.2, 0.9])
def test_cost_is_the_action_of_each_that_cures_it_together(side):
    corners = [
        (side * math.cos(a), side * math.sin(a)) for a in (0.1, 0.1 + 2 * math.pi / 3, 0.1 + 4 * math.pi / 3)
    ]
    places = []
    for own in range(3):
        team = team_at(*corners, own=own)
        found = slope(CLUSTER, team)
        share = -3 * gain(4) * tensor([found.d_x, found.d_y])
        places.append(position_after(team.own, share, 4))
        assert found.cost == pytest.approx(0.5 * share.square().sum().item())
    places = torch.stack(places)
    assert (places - places.mean(0)).norm(dim=1).mean().item() == pytest.approx(CLUSTER.radius_m)


def test_a_robot_at_the_fences_centre_is_driven_out():
    found = slope(FENCE, team_at(FENCE.centre_m))
    assert math.isfinite(found.cost)
    assert math.hypot(found.d_x, found.d_y) == pytest.approx(math.sqrt(2 * found.cost) / gain(4))


def test_robots_at_one_point_are_driven_apart_evenly():
    found = [slope(CLUSTER, team_at((0.1, 0.7), (0.1, 0.7), (0.1, 0.7), own=own)) for own in range(3)]
    pushes = -np.array([[s.d_x, s.d_y] for s in found])
    np.testing.assert_allclose(pushes.sum(0), 0.0, atol=1e-9)
    directions = pushes / np.linalg.norm(pushes, axis=1, keepdims=True)
    np.testing.assert_allclose(directions @ directions.T, 1.5 * np.eye(3) - 0.5, atol=1e-9)


def test_alone_there_is_no_cluster_to_keep():
    assert slope(CLUSTER, team_at((0.5, 0.5))) == Slope(0.0)


def test_outside_the_fence_nothing_is_asked():
    assert slope(FENCE, team_at((0.45, -0.05))) == Slope(0.0)


TOML = """
[[objectives]]
type = "geofence"
centre_m = [0.0, 0]
radius_m = 0.3

[[objectives]]
type = "clustering"
radius_m = 0.3
look_ahead = 6
"""


def test_objectives_files_know_them(tmp_path):
    path = tmp_path / "objectives.toml"
    path.write_text(TOML)
    fence, cluster = load_objective_set(path).objectives
    assert fence == Geofence(centre_m=(0.0, 0.0), radius_m=0.3)
    assert cluster == Clustering(radius_m=0.3, look_ahead=6)


@pytest.mark.parametrize(
    ("right", "wrong", "complaint"),
    [
        ("[0.0, 0]", "[0.0, inf]", "finite"),
        ("[0.0, 0]", "[0.0]", "centre_m"),
        ("radius_m = 0.3\n\n", "radius_m = 0.0\n\n", "`radius_m` must be positive"),
        (
            "radius_m = 0.3\n\n",
            "radius_m = 0.3\nbuffer_m = -0.1\n\n",
            "`buffer_m` must not be negative, got -0.1",
        ),
        ("radius_m = 0.3\nlook", "radius_m = -0.3\nlook", "`radius_m` must be positive, got -0.3"),
        ("radius_m = 0.3\nlook", "radius_m = nan\nlook", "finite"),
        ("radius_m = 0.3\nlook", "target = 0.3\nlook", "objectives[1]"),
    ],
)
def test_bad_numbers_are_refused_in_one_line(tmp_path, right, wrong, complaint):
    path = tmp_path / "objectives.toml"
    assert right in TOML
    path.write_text(TOML.replace(right, wrong))
    with pytest.raises(ConfigError) as caught:
        load_objective_set(path)
    message = str(caught.value)
    assert str(path) in message
    assert complaint in message
    assert "\n" not in message


def test_a_fence_must_be_somewhere():
    with pytest.raises(ValueError, match="`centre_m` must lie in"):
        Geofence(centre_m=(0.0, math.inf), radius_m=0.3)


def test_the_cluster_is_of_those_in_sight():
    assert slope(CLUSTER, team_at((0.0, 0.0), (0.6, 0.0))).cost == pytest.approx(0.0, abs=1e-12)
    assert slope(CLUSTER, team_at((0.0, 0.0), (0.6, 0.0), (0.3, 0.0))).cost > 0.5
