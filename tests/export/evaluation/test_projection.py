"""Projections of any action size: against the plane's, and the cone against an independent solver."""

import itertools

import numpy as np
import pytest
import scipy.optimize
from guidance_cases import problems
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.guidance.projection import COMBINE, cone
from export.evaluation.projection import BATCH, cone_batch, harmonize_batch, hierarchical_batch


@given(problems(), st.sampled_from(sorted(COMBINE)))
def test_planar_and_batched_agree(problem, mode):
    gradients, factors, nominal = problem
    single = COMBINE[mode](gradients, factors, nominal)
    many = BATCH[mode](np.array(gradients)[:, None], np.array(factors), np.array([nominal]))[0]
    scale = max(
        1.0, *np.abs(single), sum(f * np.linalg.norm(g) for f, g in zip(factors, gradients, strict=True))
    )
    assert np.allclose(single, many, atol=1e-9 * scale)


@given(st.integers(1, 6), st.integers(1, 8), st.integers(0, 10_000), st.booleans())
def test_cone_is_the_nearest_point_of_the_cone(count, dimension, seed, repeated):
    """Moreau: the projection is w + G^T mu with mu from non-negative least squares."""
    draw = np.random.default_rng(seed)
    gradients, factors = draw.standard_normal((count, 1, dimension)), draw.uniform(0.1, 3, count)
    if repeated:  # some oppose each other, some are the same, some are nothing
        gradients[1:] = gradients[:1] * draw.integers(-1, 2, (count - 1, 1, 1))
    matrix = gradients[:, 0]
    target = factors @ matrix
    multipliers, _ = scipy.optimize.nnls(matrix.T, -target)
    nearest = target + multipliers @ matrix
    assert np.allclose(cone_batch(gradients, factors, np.zeros((1, dimension)))[0], nearest, atol=1e-8)
    single = cone(list(map(tuple, matrix.tolist())), factors.tolist(), (0.0,) * dimension)
    assert np.allclose(single, nearest, atol=1e-8)


def test_batched_projections_take_any_action_size():
    draw = np.random.default_rng(3)
    gradients, nominal = draw.standard_normal((3, 5, 4)), draw.standard_normal((5, 4))
    factors = np.ones(3)
    assert harmonize_batch(gradients, factors).shape == (5, 4)
    result = hierarchical_batch(gradients, factors, nominal)
    assert ((result * nominal).sum(-1) >= -1e-9).all()


@pytest.mark.parametrize("zeros", list(itertools.product([0.0, 1.0], repeat=3)))
def test_zero_gradients_and_zero_flow_are_harmless(zeros):
    first, second, flow = zeros
    gradients = np.array([[(first, 0.0)], [(-second, second)]])
    for combine in BATCH.values():
        assert np.isfinite(combine(gradients, np.ones(2), np.array([[0.0, flow]]))).all()
