"""Velocity and Jacobian of every backend against torch autograd in float64."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import random_weights

from edge_runtime.errors import PolicyError
from edge_runtime.policy.numpy_policy import FlowPolicy

torch = pytest.importorskip("torch")
from torch_oracle import velocity  # noqa: E402

WIDTHS = [(1,), (5, 3), (16, 16), (64, 48), (256, 256, 256)]


def draw_weights(hidden, activation="silu", **more):
    return random_weights(hidden=hidden, activation=activation, **{"observation_dim": 7, **more})


def oracle(weights, action, tau, observation):
    """Velocity (B, d) and tangents (d, B, d) by autograd in float64."""
    velocities, jacobians = [], []
    for a, t, o in zip(torch.as_tensor(action, dtype=torch.float64), tau, observation, strict=True):
        velocities.append(velocity(weights, a, t, o).numpy())
        jacobian = torch.autograd.functional.jacobian(partial(velocity, weights, tau=t, observation=o), a)
        jacobians.append(jacobian.numpy().T)
    return np.stack(velocities), np.stack(jacobians, 1)


def inputs(policy, seed=1):
    rng = np.random.default_rng(seed)
    action = rng.standard_normal((policy.batch, policy.action_dim)).astype(np.float32)
    return action, rng.standard_normal((policy.batch, policy.observation_dim)).astype(np.float32)


def assert_field(policy, weights, k, seed=1):
    action, observation = inputs(policy, seed)
    policy.observe(observation)
    result = policy.step(k, action)
    value, tangents = oracle(weights, action, np.full(policy.batch, policy.schedule[k].tau), observation)
    np.testing.assert_allclose(result[0], value, rtol=2e-5, atol=4e-6)
    np.testing.assert_allclose(result[1:], tangents, rtol=2e-5, atol=4e-6)


@pytest.mark.parametrize("hidden", WIDTHS, ids=str)
@pytest.mark.parametrize("activation", ["silu", "tanh"])
@pytest.mark.parametrize("batch", [1, 2, 8])
def test_step_matches_autograd(make_backend, hidden, activation, batch):
    weights = draw_weights(hidden, activation)
    policy = make_backend(weights, steps=4, batch=batch)
    for k in range(4):
        assert_field(policy, weights, k, seed=k)


@settings(max_examples=40, deadline=None)
@given(
    hidden=st.lists(st.integers(1, 40), min_size=1, max_size=4),
    activation=st.sampled_from(["silu", "tanh"]),
    sizes=st.tuples(st.integers(1, 4), st.integers(1, 20), st.integers(0, 5)),
    batch=st.integers(1, 9),
    prior_std=st.sampled_from([None, 0.3, 1.0]),
    seed=st.integers(0, 2**16),
)
def test_any_network_matches_autograd(make_backend, hidden, activation, sizes, batch, prior_std, seed):
    names = ("action_dim", "observation_dim", "features")
    shape = dict(zip(names, sizes, strict=True))
    weights = draw_weights(hidden, activation, prior_std=prior_std, seed=seed, **shape)
    assert_field(make_backend(weights, steps=3, batch=batch), weights, k=seed % 3, seed=seed)


@pytest.mark.parametrize("activation", ["silu", "tanh"])
def test_saturated_activations_stay_exact(make_backend, activation):
    weights = draw_weights((16, 16), activation)
    policy = make_backend(weights, steps=2, batch=2)
    action, observation = np.array([[80.0, -80.0], [-300.0, 300.0]]), 50 * inputs(policy)[1]
    policy.observe(observation)
    result = policy.step(1, action)
    value, tangents = oracle(weights, action, np.full(2, 0.5), observation)
    np.testing.assert_allclose(result[0], value, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(result[1:], tangents, rtol=1e-5, atol=1e-4)


def test_a_row_of_a_batch_is_the_policy_of_one(make_backend):
    weights = draw_weights((64, 64))
    many, one = make_backend(weights, steps=3, batch=5), make_backend(weights, steps=3, batch=1)
    action, observation = inputs(many)
    many.observe(observation)
    together = many.step(2, action)
    for row in range(5):
        one.observe(observation[row : row + 1])
        alone = one.step(2, action[row : row + 1])
        np.testing.assert_allclose(together[:, row], alone[:, 0], rtol=1e-5, atol=1e-6)


def test_non_finite_input_gives_a_non_finite_velocity(make_backend):
    policy = make_backend(draw_weights((32, 32)), steps=2, batch=1)
    policy.observe(np.full((1, 7), np.nan, np.float32))
    assert np.isnan(policy.step(0, ((0.0, 0.0),))[0]).all()


def test_a_new_observation_replaces_the_old(make_backend):
    weights = draw_weights((32,))
    policy = make_backend(weights, steps=2, batch=1)
    for seed in range(3):
        assert_field(policy, weights, k=0, seed=seed)


def test_evaluate_takes_any_flow_time():
    weights = draw_weights((16, 16))
    policy = FlowPolicy(weights, steps=2, batch=3)
    action, observation = inputs(policy)
    tau = np.array([0.0, 0.37, 1.0])
    value, tangents = oracle(weights, action, tau, observation)
    result = policy.evaluate(action, tau, observation)
    np.testing.assert_allclose(result[0], value, rtol=1e-5, atol=2e-6)
    np.testing.assert_allclose(result[1:], tangents, rtol=1e-5, atol=2e-6)


@pytest.mark.parametrize("shape", [(1, 6), (2, 7), (7,)])
def test_a_wrong_observation_shape_is_named(make_backend, shape):
    policy = make_backend(draw_weights((8,)), steps=2, batch=1)
    with pytest.raises(PolicyError, match=r"\(1, 7\)"):
        policy.observe(np.zeros(shape, np.float32))


@pytest.mark.parametrize(("steps", "batch"), [(0, 1), (1, 0), (-3, 1)])
def test_sizes_below_one_are_refused(make_backend, steps, batch):
    with pytest.raises(PolicyError, match="at least 1"):
        make_backend(draw_weights((8,)), steps=steps, batch=batch)
