"""What actions are worth: slopes against autograd, files against what else may lie there."""

from pathlib import Path

import numpy as np
import pytest
import torch

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import load_bundle
from export.values.action_value import load_value, save_value
from export.values.fit import exported, fit_value

BALANCE = Path(__file__).parents[3] / "edge_runtime" / "bundles" / "balance"


@pytest.fixture(scope="module")
def value():
    return fit_value(load_bundle(BALANCE), "balance", "of this policy", seed=0, teams=8)


def judged(value, observation, action):
    """The network, written down with PyTorch's own functions."""
    names = ("observation", "action", "bias", "hidden", "hidden_bias", "output")
    seen, own, bias, hidden, hidden_bias, output = (
        torch.from_numpy(getattr(value, name)).double() for name in names
    )
    first = torch.nn.functional.silu(observation @ seen + action @ own + bias)
    return torch.nn.functional.silu(first @ hidden + hidden_bias) @ output


def test_slopes_are_those_of_the_network(value):
    draw = torch.Generator().manual_seed(0)
    observation = torch.randn(32, len(value.observation), generator=draw, dtype=torch.float64).float()
    action = torch.randn(32, 2, generator=draw, dtype=torch.float64, requires_grad=True)
    judged(value, observation.double(), action).sum().backward()
    slopes = value.slopes(observation.numpy())(action.detach().numpy())
    np.testing.assert_allclose(slopes, action.grad.numpy(), rtol=1e-9, atol=1e-12)
    assert np.abs(slopes).max() > 1e-3


def test_what_is_exported_is_what_was_fitted_to_normalised_observations():
    draw = torch.Generator().manual_seed(1)
    widths = ((18, 64), (64, 64), (64, 1))
    first, second, last = (torch.nn.Linear(*each) for each in widths)
    network = torch.nn.Sequential(first, torch.nn.SiLU(), second, torch.nn.SiLU(), last)
    mean, deviation = torch.randn(16, generator=draw), torch.rand(16, generator=draw) + 0.5
    observation = torch.randn(32, 16, generator=draw)
    action = torch.randn(32, 2, generator=draw, requires_grad=True)
    network(torch.cat([(observation - mean) / deviation, action], 1)).sum().backward()
    value = exported(network, mean, deviation, "of this policy")
    slopes = value.slopes(observation.numpy())(action.detach().double().numpy())
    np.testing.assert_allclose(slopes, action.grad.numpy(), rtol=1e-4, atol=1e-5)


def test_a_file_gives_back_what_was_saved(tmp_path, value):
    save_value(tmp_path / "new" / "value.npz", value)
    again = load_value(tmp_path / "new" / "value.npz", "of this policy")
    for name in ("observation", "action", "bias", "hidden", "hidden_bias", "output"):
        assert np.array_equal(getattr(again, name), getattr(value, name))


def test_another_policys_file_is_refused(tmp_path, value):
    save_value(tmp_path / "value.npz", value)
    with pytest.raises(ConfigError, match=r"judges another policy.*make it with python -m benchmarks values"):
        load_value(tmp_path / "value.npz", "of another")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04nonsense", b"\x93NUMPY"])
def test_a_file_of_anything_else_is_refused(tmp_path, content):
    (tmp_path / "value.npz").write_bytes(content)
    with pytest.raises(ConfigError, match="holds no value of actions: make it with"):
        load_value(tmp_path / "value.npz", "of this policy")


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(ConfigError, match="make it with python -m benchmarks values"):
        load_value(tmp_path / "value.npz", "of this policy")
