"""The torch network against the runtime's written mathematics, evaluated in float64 numpy."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.policy.weights import FlowWeights
from export.algorithms.networks import Critic, FlowNetwork
from export.common.distributed import Workers

ACTIVATIONS = {"tanh": np.tanh, "silu": lambda x: x / (1 + np.exp(-x))}


def velocity_of(weights: FlowWeights, action, tau, observation):
    activate = ACTIVATIONS[weights.activation]
    x = action @ weights.action + observation @ weights.observation + weights.time_part(tau)
    for matrix, bias in zip(weights.matrices, weights.biases[1:], strict=True):
        x = activate(x) @ matrix + bias
    return x + weights.prior_gain(tau)[..., None] * action


def random_network(seed: int, activation: str, prior_std: float | None, hidden=(16, 24)) -> FlowNetwork:
    generator = torch.Generator().manual_seed(seed)
    network = FlowNetwork(7, 2, hidden, activation, prior_std)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator) * 0.4)
    network.moments.update(3 * torch.randn(200, 7, generator=generator) + 1, Workers())
    return network


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    activation=st.sampled_from(["silu", "tanh"]),
    prior_std=st.sampled_from([None, 0.2, 0.5, 1.0]),
    hidden=st.sampled_from([(8,), (16, 24), (16, 8, 12)]),
)
def test_exported_weights_compute_the_same_field(seed, activation, prior_std, hidden):
    network = random_network(seed, activation, prior_std, hidden)
    rng = np.random.default_rng(seed)
    action, observation = rng.normal(size=(50, 2)), 3 * rng.normal(size=(50, 7)) + 1
    tau = rng.uniform(size=50)
    tensors = [torch.tensor(x, dtype=torch.float32) for x in (action, tau[:, None], observation)]
    expected = velocity_of(network.to_weights(), action, tau, observation)
    np.testing.assert_allclose(network(*tensors).detach(), expected, atol=3e-5, rtol=1e-5)


def test_prior_field_alone_samples_its_gaussian():
    network = FlowNetwork(3, 2, prior_std=0.3)
    torch.nn.init.zeros_(network.layers[-1].weight)
    start = torch.randn(100, 2)
    with torch.no_grad():
        action = network.sample(torch.zeros(100, 3), start, steps=2000)
    torch.testing.assert_close(action, 0.3 * start, atol=2e-3, rtol=5e-3)


def test_one_context_serves_many_flow_times():
    network = random_network(0, "silu", 0.5)
    observation, action, tau = torch.randn(5, 7), torch.randn(5, 4, 2), torch.rand(5, 4, 1)
    together = network.velocity(network.context(observation)[:, None], action, tau)
    apart = network(action, tau, observation[:, None].expand(5, 4, 7))
    torch.testing.assert_close(together, apart)


def test_critic_values_each_robot_from_its_own_view():
    critic = Critic(observation_dim=3, robots=4)
    torch.nn.init.normal_(critic.layers[-1].weight)
    team = torch.randn(6, 4, 3)
    value = critic(team)
    assert value.std(1).min() > 0
    torch.testing.assert_close(critic(team.roll(1, 1)), value.roll(1, 1))


@pytest.mark.parametrize("steps", [1, 10])
def test_sampling_is_euler_integration(steps):
    network = random_network(3, "tanh", 0.5)
    observation, action = torch.randn(9, 7), torch.randn(9, 2)
    sampled = network.sample(observation, action, steps)
    for k in range(steps):
        action = action + network(action, torch.full((9, 1), k / steps), observation) / steps
    torch.testing.assert_close(sampled, action)
