"""MAPPO against torch.distributions and autograd, and its mean as the flow that robots run."""

import numpy as np
import pytest
import torch
from torch.distributions import MultivariateNormal

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.policy.bundle import load_bundle
from export.algorithms.mappo import Mappo
from export.edge_export import export_run
from export.training.checkpoint import PolicyFacts, save_policy


@pytest.fixture
def algorithm():
    torch.manual_seed(0)
    algorithm = Mappo(18, 2)
    for parameter in algorithm.actor.parameters():
        parameter.data.add_(0.3 * torch.randn_like(parameter))
    algorithm.actor.moments.mean += torch.randn(18)
    algorithm.actor.moments.variance *= 4.0
    return algorithm


def explored(algorithm, rows=64):
    generator = torch.Generator().manual_seed(1)
    observation = torch.randn(rows, 18, generator=generator)
    with torch.no_grad():
        return observation, *algorithm.explore(observation, generator)


def test_log_likelihood_is_the_density_of_a_diagonal_gaussian(algorithm):
    observation, action, trace = explored(algorithm)
    covariance = torch.diag((2 * algorithm.actor.log_deviation).exp())
    expected = MultivariateNormal(algorithm.act(observation, action), covariance).log_prob(action)
    torch.testing.assert_close(algorithm.log_likelihood(observation, action, trace), expected)


def test_explores_around_the_mean_with_the_learned_deviation(algorithm):
    observation = torch.randn(1, 18).expand(20_000, 18)
    with torch.no_grad():
        action, trace = algorithm.explore(observation, torch.Generator().manual_seed(0))
        mean = algorithm.act(observation, torch.randn(20_000, 2))
    assert trace.shape == (20_000, 0)
    torch.testing.assert_close(action.mean(0), mean[0], atol=0.02, rtol=0)
    torch.testing.assert_close(action.std(0), algorithm.actor.log_deviation.exp(), atol=0.01, rtol=0)


def test_gradient_at_the_old_weights_is_the_policy_gradient(algorithm):
    samples, advantage = explored(algorithm), torch.randn(64)
    likelihood = algorithm.log_likelihood(*samples)
    ratio = algorithm.ratio(likelihood, likelihood.detach())
    parameters = list(algorithm.actor.parameters())
    expected = torch.autograd.grad((advantage * likelihood).mean(), parameters, retain_graph=True)
    found = torch.autograd.grad(algorithm.objective(ratio, advantage).mean(), parameters)
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a, b)


def test_clip_stops_the_gradient_outside_the_trust_region_only(algorithm):
    ratio = torch.tensor([0.5, 0.9, 1.1, 1.5, 0.5, 0.9, 1.1, 1.5], requires_grad=True)
    advantage = torch.tensor([1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
    (gradient,) = torch.autograd.grad(algorithm.objective(ratio, advantage).sum(), ratio)
    assert gradient.tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, -1.0]


@pytest.fixture
def bundle(algorithm, tmp_path):
    facts = PolicyFacts(
        "navigation", "mappo", 0, 1000, "abc", 0.9, algorithm.euler_steps, algorithm.actor.start
    )
    save_policy(tmp_path, algorithm.actor, facts)
    assert export_run(tmp_path, tmp_path / "bundle") < 1e-5
    return load_bundle(tmp_path / "bundle")


def test_robots_compute_the_mean_in_one_euler_step_from_zero(algorithm, bundle):
    observation = torch.randn(100, 18)
    with torch.no_grad():
        mean = algorithm.actor(observation).mean.numpy()
    assert bundle.manifest.euler_steps == 1
    for policy in (bundle.policy(100), bundle.graph_policy(100)):
        policy.observe(observation.numpy())
        result = policy.step(0, np.zeros((100, 2), np.float32))
        np.testing.assert_allclose(result[0], mean, rtol=1e-5, atol=1e-5)
        assert not result[1:].any()  # guidance moves the action itself: A = I in eq. 11


def test_a_robot_starts_from_zero_whatever_noise_the_fleet_asks_for(algorithm, bundle):
    fleet = load_fleet(DEFAULT_FLEET)
    assert fleet.objective_set.guidance.start_noise == GuidanceSettings().start_noise == 1.0
    controller = Mission(0, fleet, bundle, fleet.objective_set, 10.0, guided=False).controller(0)
    team = TeamState(RobotState(0, 0.0, (0.1, 0.2), (0.0, 0.1)))
    observation = controller.observe(team)
    with torch.no_grad():
        mean = algorithm.actor(torch.from_numpy(observation)).mean[0]
    np.testing.assert_allclose(controller.act(observation, team).action, mean, rtol=1e-5, atol=1e-5)
