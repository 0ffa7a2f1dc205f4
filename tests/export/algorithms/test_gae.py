import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from export.algorithms.gae import advantages


def brute_force(reward, value, last_value, done, discount, gae_lambda):
    """Term by term: sums of (gamma lambda)^l delta_(t+l) up to the episode's end."""
    steps = len(reward)
    following = [*value[1:], last_value]
    result = torch.zeros_like(reward)
    for t in range(steps):
        weight = 1.0
        for k in range(t, steps):
            beyond = 0.0 if done[k] else following[k]
            result[t] += weight * (reward[k] + discount * beyond - value[k])
            if done[k]:
                break
            weight *= discount * gae_lambda
    return result


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    steps=st.integers(1, 12),
    discount=st.floats(0, 1),
    gae_lambda=st.floats(0, 1),
)
def test_advantages_are_the_defining_sums(seed, steps, discount, gae_lambda):
    generator = torch.Generator().manual_seed(seed)
    reward, value = torch.randn(2, steps, 3, 2, generator=generator, dtype=torch.float64)
    last_value = torch.randn(3, 2, generator=generator, dtype=torch.float64)
    done = torch.rand(steps, 3, generator=generator) < 0.3
    result = advantages(reward, value, last_value, done, discount=discount, gae_lambda=gae_lambda)
    for b in range(3):
        for n in range(2):
            expected = brute_force(
                reward[:, b, n], value[:, b, n], last_value[b, n], done[:, b], discount, gae_lambda
            )
            torch.testing.assert_close(result[:, b, n], expected)
