"""How a flow is integrated: what is exact, of which order the rest is, and that all backends do the same."""

import itertools

import numpy as np
import pytest
import scipy.integrate
from guidance_cases import OBJECTIVES, Stepwise, gaussian_flow, guide_for, random_team
from hypothesis import given
from hypothesis import strategies as st
from networks import needs_kernel, random_weights

from edge_runtime.guidance.flow import guided_action
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.policy.flow_steps import SAMPLERS, flow_steps
from edge_runtime.policy.numpy_policy import FlowPolicy

TEAM = random_team(np.random.default_rng(0))
UNGUIDED = guide_for(())
deviations = st.one_of(st.none(), st.floats(0.05, 2.0))


@given(sampler=st.sampled_from(SAMPLERS), count=st.integers(1, 30), std=deviations)
def test_steps_lead_from_noise_to_the_action(sampler, count, std):
    steps = flow_steps(sampler, count, std)
    assert len(steps) == count
    assert steps[0].tau == 0.0
    assert all(one.tau < other.tau for one, other in itertools.pairwise(steps))
    assert all(step.tau < 1.0 and step.keep > 0.0 and step.gain > 0.0 and step.ahead >= 0.0 for step in steps)


@given(count=st.integers(1, 30), std=deviations)
def test_the_prior_field_is_integrated_exactly(count, std):
    """Where the network says nothing, the flow takes N(0, 1) to N(0, s^2) in any number of steps."""
    steps = flow_steps("exponential", count, std)
    action = 1.7
    for step in steps:
        action = step.end(action, 0.0, 0.0, 0.0)
    assert action == pytest.approx(1.7 * (std or 1.0), rel=1e-12)


@pytest.mark.parametrize("std", [None, 0.2, 0.5])
def test_a_velocity_that_is_held_is_integrated_exactly(std):
    """One of its own size, beside the prior field: against a general solver."""
    gain = lambda t: (t * std**2 - 1 + t) / ((1 - t) ** 2 + t**2 * std**2) if std else 0.0  # noqa: E731
    ends = []
    for count in (1, 2, 5):
        action = -0.4
        for step in flow_steps("exponential", count, std):
            action = step.end(action, 0.9, 0.9, 0.0)
        ends.append(action)
    exact = scipy.integrate.solve_ivp(lambda t, a: gain(t) * a + 0.9, (0, 1), [-0.4], rtol=1e-11, atol=1e-13)
    assert ends == pytest.approx([exact.y[0, -1]] * 3, abs=1e-9)


def ends(policy, observations, starts):
    """Where unguided flows end."""
    policy.observe(observations)
    action, network = starts, np.zeros_like(starts)
    for k, step in enumerate(policy.schedule):
        before, network = network, step.network(action, policy.velocity(k, action))
        action = step.end(action, network, before, 0.0)
    return action


@pytest.mark.parametrize(("sampler", "order"), [("euler", 1), ("exponential", 2)])
@pytest.mark.parametrize("std", [0.5, None])
def test_the_order_of_convergence(sampler, order, std):
    """Against a fine solution: doubling the steps divides the error by 2 to the power of the order."""
    weights, draw = random_weights(seed=3, prior_std=std), np.random.default_rng(0)
    inputs = draw.standard_normal((100, 18)).astype(np.float32), draw.standard_normal((100, 2))
    fine = ends(FlowPolicy(weights, 500, 100, "exponential"), *inputs)
    apart = [ends(FlowPolicy(weights, count, 100, sampler), *inputs) - fine for count in (16, 32, 64)]
    errors = np.sqrt(np.square(apart).mean((1, 2)))
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(order, abs=0.35)


def test_few_steps_of_the_exponential_sampler_do_what_many_of_eulers_do():
    """On a packaged policy, in what it observes: three steps are as near to the fine solution as ten."""
    bundle, draw = packaged_bundle("balance"), np.random.default_rng(0)
    field = [each.seen for each in bundle.manifest.observation]
    low, high = np.array([pair for pairs in field for pair in pairs]).T
    observations = draw.uniform(0.5 * low, 0.5 * high, (200, len(low))).astype(np.float32)
    starts = draw.standard_normal((200, 2))
    fine, many, few = (
        ends(bundle.sampled(*choice).policy(200), observations, starts)
        for choice in (("exponential", 200), ("euler", 10), ("exponential", 3))
    )
    assert np.square(few - fine).mean() < np.square(many - fine).mean()


def test_the_closed_form_flow_is_reached_in_few_steps():
    std, mean, start = 0.5, np.array([0.3, -0.2]), (0.4, -1.0)
    flow = gaussian_flow(std, mean, 40, "exponential")
    found = guided_action(flow, np.zeros((1, 1), np.float32), TEAM, UNGUIDED, start)
    assert found.action == pytest.approx(mean + std * np.array(start), abs=2e-3)


@pytest.mark.parametrize("hidden", [(5,), (64, 48), (256, 256, 256)], ids=str)
@pytest.mark.parametrize("batch", [1, 3])
def test_the_velocity_alone_is_the_velocity(make_backend, hidden, batch):
    policy, draw = (
        make_backend(random_weights(hidden=hidden), 3, batch, "exponential"),
        np.random.default_rng(1),
    )
    policy.observe(draw.standard_normal((batch, 18)))
    for k in range(3):
        action = draw.standard_normal((batch, 2))
        alone = policy.velocity(k, action).copy()
        assert alone.shape == (batch, 2)
        np.testing.assert_allclose(alone, policy.step(k, action)[0], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("mode", ["none", "cone", "terminal", "correction"])
@pytest.mark.parametrize("std", [None, 0.5])
def test_every_backend_takes_the_same_steps(make_compiled, mode, std):
    weights, guide = random_weights(prior_std=std), guide_for(OBJECTIVES[:2], mode=mode, scale=1.0)
    numpy, compiled = (make(weights, 4, sampler="exponential") for make in (FlowPolicy, make_compiled))
    for seed in range(5):
        draw = np.random.default_rng(seed)
        team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
        start = tuple(draw.standard_normal(2).tolist())
        for most in (1, 2, 3, None):
            expected, *found = (
                guided_action(policy, observation, team, guide, start, most_steps=most)
                for policy in (numpy, compiled, Stepwise(compiled))
            )
            for one in found:
                assert (one.steps, one.cut) == (expected.steps, expected.cut) == (most or 4, most is not None)
                np.testing.assert_allclose(one.action, expected.action, rtol=1e-4, atol=1e-5)


@needs_kernel
@pytest.mark.parametrize("name", ["navigation", "balance", "sampling"])
def test_graph_and_kernel_of_a_bundle_sample_as_numpy(name):
    pytest.importorskip("onnxruntime")
    bundle, draw = packaged_bundle(name).sampled("exponential", 3), np.random.default_rng(2)
    policies = [bundle.policy(), bundle.field("compiled"), bundle.graph_policy()]
    for _ in range(20):
        observation = draw.standard_normal((1, bundle.manifest.observation_dim)).astype(np.float32)
        team, start = random_team(draw), tuple(draw.standard_normal(2).tolist())
        expected, *found = (guided_action(each, observation, team, UNGUIDED, start) for each in policies)
        for one in found:
            np.testing.assert_allclose(one.action, expected.action, rtol=1e-5, atol=1e-5)
