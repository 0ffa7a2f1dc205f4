"""Matching a flow to a Gaussian policy, against the closed form of the flow that carries N(0, I) to it."""

import math

import pytest
import scipy.integrate
import torch

from export.algorithms import mafpo_warm
from export.algorithms.mafpo_warm import DEVIATION, MafpoWarm, match
from export.algorithms.networks import FlowNetwork
from export.common.distributed import Workers

STEPS = 100
"""Euler steps of a sample; enough to tell the flow from its discretisation."""


def mean(observation):
    """mu(o), as smooth and as large as a policy's."""
    return torch.stack(
        [observation[..., 0].tanh(), 0.5 * observation[..., 1] * observation[..., 2].cos()], -1
    )


@pytest.fixture(scope="module")
def matched():
    """A flow matched in fewer and smaller steps than a real one, its observations, and the error reported."""
    torch.manual_seed(0)
    flow, observation = FlowNetwork(4, 2, prior_std=0.2), 2 * torch.rand(4000, 4) - 1
    flow.moments.update(3 * observation + 1, Workers())
    moments = {name: value.clone() for name, value in flow.moments.state_dict().items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mafpo_warm, "BATCH", 512)
        error = match(flow, mean, observation, torch.Generator().manual_seed(0), steps=1500)
    assert all(torch.equal(value, moments[name]) for name, value in flow.moments.state_dict().items())
    return flow, 2 * torch.rand(200, 4) - 1, error


def test_the_closed_form_carries_a_standard_normal_to_the_gaussian_policy():
    """The velocity of the module's docstring, integrated: from z at tau = 0 to mu + s z."""
    s, mu, z = DEVIATION, 0.7, -1.3

    def velocity(tau, action):
        k = (tau * s**2 - (1 - tau)) / ((1 - tau) ** 2 + (tau * s) ** 2)
        return k * action + (1 - tau * k) * mu

    path = scipy.integrate.solve_ivp(velocity, (0, 1), [z], rtol=1e-9, atol=1e-11)
    assert path.y[0, -1] == pytest.approx(mu + s * z, abs=1e-6)


@torch.no_grad()
def test_every_start_is_carried_to_the_mean_plus_its_share_of_the_deviation(matched):
    flow, observation, _ = matched
    start = torch.randn(len(observation), 2, generator=torch.Generator().manual_seed(1))
    miss = flow.sample(observation, start, STEPS) - (mean(observation) + flow.prior_std * start)
    assert miss.square().mean().sqrt() < 0.05


@torch.no_grad()
def test_samples_have_the_policys_mean_and_nearly_its_deviation(matched):
    flow, observation = matched[0], matched[1][:40]
    start = torch.randn(500, 1, 2, generator=torch.Generator().manual_seed(2))
    action = flow.sample(observation, start.expand(-1, len(observation), -1), STEPS)
    assert (action.mean(0) - mean(observation)).square().mean().sqrt() < 0.06
    assert action.std(0).mean() == pytest.approx(flow.prior_std, rel=0.1)
    assert (action.std(0) / flow.prior_std - 1).abs().mean() < 0.2


@torch.no_grad()
def test_the_error_reported_is_that_of_the_mean(matched):
    flow, observation, error = matched
    action = flow.sample(observation, torch.zeros(len(observation), 2), STEPS)
    found = (action - mean(observation)).square().mean().sqrt().item()
    assert 0.0 < error < 0.1
    assert math.log(found / error) == pytest.approx(0.0, abs=1.2)


def test_a_flow_without_a_prior_field_cannot_be_matched():
    flow = FlowNetwork(4, 2, prior_std=None)
    with pytest.raises(ValueError, match="no deviation to match"):
        match(flow, mean, torch.rand(8, 4), torch.Generator(), steps=1)


def test_it_is_the_chain_from_its_own_deviation_and_noise():
    algorithm = MafpoWarm(4, 2)
    assert algorithm.actor.as_flow().prior_std == DEVIATION
    assert algorithm.actor.log_step_noise.exp().tolist() == pytest.approx([MafpoWarm.step_noise] * 2)
    observation, generator = torch.randn(32, 4), torch.Generator().manual_seed(0)
    action, trace = algorithm.explore(observation, generator)
    assert trace.view(32, algorithm.euler_steps + 1, 2)[:, -1].equal(action)
