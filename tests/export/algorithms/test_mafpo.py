"""MAFPO's equations against closed forms and against autograd."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from export.algorithms.mafpo import Mafpo, conditional_flow_matching_loss
from export.algorithms.networks import FlowNetwork


def explored(algorithm, rows=64, seed=0):
    generator = torch.Generator().manual_seed(seed)
    observation = torch.randn(rows, algorithm.actor.observation_dim, generator=generator)
    with torch.no_grad():
        return observation, *algorithm.explore(observation, generator)


def perturb(network, scale=0.1):
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(scale * torch.randn_like(parameter))


@pytest.mark.parametrize("std", [0.3, 0.5, 1.0])
def test_loss_of_a_gaussian_on_its_own_samples_is_pi_s(std):
    """No field does better on N(0, s^2 I) in two dimensions: the integral over tau of the conditional
    variance 2 s^2 / ((1 - tau)^2 + tau^2 s^2) is pi s."""
    torch.manual_seed(0)
    actor = FlowNetwork(3, 2, prior_std=std)
    torch.nn.init.zeros_(actor.layers[-1].weight)
    action, noise, tau = std * torch.randn(20_000, 2), torch.randn(20_000, 8, 2), torch.rand(20_000, 8, 1)
    loss = conditional_flow_matching_loss(
        actor, torch.zeros(20_000, 3), action, noise, tau, terminal_weight=False
    )
    assert loss.mean().item() == pytest.approx(math.pi * std, rel=0.02)


def test_terminal_weight_measures_the_terminal_estimate():
    """(1 - tau)^2 |v - (a1 - a0)|^2 is the squared error of eq. 10's estimate a + (1 - tau) v."""
    torch.manual_seed(0)
    actor = FlowNetwork(3, 2)
    perturb(actor)
    observation, action, noise, tau = (
        torch.randn(9, 3),
        torch.randn(9, 2),
        torch.randn(9, 1, 2),
        torch.rand(9, 1, 1),
    )
    path = ((1 - tau) * noise + tau * action[:, None])[:, 0]
    estimate = path + (1 - tau[:, 0]) * actor(path, tau[:, 0], observation)
    loss = conditional_flow_matching_loss(actor, observation, action, noise, tau, terminal_weight=True)
    torch.testing.assert_close(loss, (estimate - action).square().sum(-1))


def test_ratio_is_one_before_the_update_and_moves_with_the_loss():
    algorithm = Mafpo(18, 2)
    samples = explored(algorithm)
    old = algorithm.log_likelihood(*samples)
    assert (algorithm.ratio(old, old) == 1).all()
    better, worse = algorithm.ratio(old + 0.1, old), algorithm.ratio(old - 0.1, old)
    torch.testing.assert_close(better * worse, torch.ones_like(old))
    assert algorithm.ratio(old + 50, old).isfinite().all()


@pytest.mark.parametrize(
    ("shift", "terminal_weight"), [(0.0, False), (0.1, True)], ids=["as in the paper", "as shipped"]
)
def test_proposition_1(shift, terminal_weight):
    """At the old weights eqs. 8 and 9 have the gradient of E[A ELBO], the bound being minus eq. 3.

    The bound is written out here draw by draw. A shift of the advantages is part of the advantage, a
    weight on flow time part of the bound.
    """
    algorithm = Mafpo(18, 2)
    algorithm.advantage_shift, algorithm.terminal_weight = shift, terminal_weight
    algorithm.half_precision = False
    torch.manual_seed(0)
    perturb(algorithm.actor)
    observation, action, trace = explored(algorithm)
    advantage, parameters = torch.randn(64), list(algorithm.actor.parameters())
    old = algorithm.log_likelihood(observation, action, trace).detach()
    ratio = algorithm.ratio(algorithm.log_likelihood(observation, action, trace), old)
    found = torch.autograd.grad(algorithm.objective(ratio, advantage).mean(), parameters)

    draws = trace.view(64, algorithm.noise_samples, 3)
    bound = torch.zeros(64)
    for noise, tau in ((draw[:, :2], draw[:, 2:]) for draw in draws.unbind(1)):
        velocity = algorithm.actor((1 - tau) * noise + tau * action, tau, observation)
        weight = (1 - tau[:, 0]) ** 2 if terminal_weight else 1.0
        bound -= weight * ((velocity - (action - noise)) ** 2).sum(1) / algorithm.noise_samples
    expected = torch.autograd.grad(((advantage + shift) * bound).mean(), parameters)
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a, b)


@given(advantage=st.floats(-3, 3), other=st.floats(0.1, 3))
def test_simple_policy_optimisation_wants_a_ratio_of_one_plus_or_minus_epsilon(advantage, other):
    """Eq. 9 is a parabola in the ratio whose top lies epsilon away from one, on the advantage's side."""
    algorithm = Mafpo(2, 2)
    side = math.copysign(1.0, advantage + algorithm.advantage_shift)
    top = torch.tensor(1 + side * algorithm.spo_epsilon)
    advantage, other = torch.tensor(advantage), torch.tensor(other)
    assert algorithm.objective(top, advantage) >= algorithm.objective(other, advantage) - 1e-5


def test_explores_with_the_policy_that_is_deployed():
    algorithm = Mafpo(18, 2)
    perturb(algorithm.actor)
    observation, action, _ = explored(algorithm, seed=3)
    generator = torch.Generator().manual_seed(3)
    torch.randn(64, 18, generator=generator)
    start = torch.randn(64, 2, generator=generator)
    torch.testing.assert_close(action, algorithm.act(observation, start))
