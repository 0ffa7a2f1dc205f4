"""Propositions 2 and 3 as properties, the cone against an independent solver, planar against batched."""

import itertools

import numpy as np
import pytest
import scipy.optimize
from hypothesis import assume, given
from hypothesis import strategies as st

from edge_runtime.guidance.projection import (
    BATCH,
    PLANAR,
    cone,
    cone_batch,
    harmonize,
    harmonize_batch,
    hierarchical,
    hierarchical_batch,
    project_onto_nominal,
)

numbers = st.floats(-10, 10).filter(lambda x: x == 0 or abs(x) > 1e-3)
planar_vector = st.tuples(numbers, numbers)


@st.composite
def problems(draw, most=8):
    count = draw(st.integers(1, most))
    gradients = draw(st.lists(planar_vector, min_size=count, max_size=count))
    factors = draw(st.lists(st.floats(0.01, 100), min_size=count, max_size=count))
    return gradients, factors, draw(planar_vector)


def descends(vector, gradients, slack=1e-9):
    lengths = [np.linalg.norm(vector) * np.linalg.norm(g) for g in gradients]
    return all(np.dot(vector, g) >= -slack * max(1.0, s) for g, s in zip(gradients, lengths, strict=True))


@given(problems())
def test_proposition_2_cone_descends_every_objective(problem):
    assert descends(cone(*problem), problem[0])


@given(problems(most=2))
def test_proposition_2_harmonized_pair_descends_both(problem):
    gradients, factors, _ = problem
    assert descends(harmonize(gradients, factors), gradients)


def test_proposition_2_fails_for_sequential_projection_of_three():
    """Why the cone exists: projecting one after the other can end up opposing an objective."""
    draw = np.random.default_rng(0)
    cases = [draw.standard_normal((3, 2)).tolist() for _ in range(1000)]
    broken = [g for g in cases if not descends(harmonize(g, [1.0, 1.0, 1.0]), g)]
    assert broken
    assert all(descends(cone(g, [1.0, 1.0, 1.0], (1.0, 0.0)), g) for g in broken)


@given(problems())
def test_proposition_3_never_opposes_the_nominal_flow(problem):
    x, y = hierarchical(*problem)
    vx, vy = problem[2]
    square = vx * vx + vy * vy
    assert (vx + x) * vx + (vy + y) * vy >= square - 1e-9 * max(1.0, square, abs(x), abs(y))


@given(problems(), st.sampled_from(sorted(PLANAR)))
def test_planar_and_batched_agree(problem, mode):
    gradients, factors, nominal = problem
    single = PLANAR[mode](gradients, factors, nominal)
    many = BATCH[mode](np.array(gradients)[:, None], np.array(factors), np.array([nominal]))[0]
    scale = max(
        1.0, *np.abs(single), sum(f * np.linalg.norm(g) for f, g in zip(factors, gradients, strict=True))
    )
    assert np.allclose(single, many, atol=1e-9 * scale)


@given(st.integers(1, 6), st.integers(2, 6), st.integers(0, 10_000))
def test_cone_is_the_nearest_point_of_the_cone(count, dimension, seed):
    """Moreau: the projection is w + G^T mu with mu from non-negative least squares."""
    draw = np.random.default_rng(seed)
    gradients, factors = draw.standard_normal((count, 1, dimension)), draw.uniform(0.1, 3, count)
    matrix = gradients[:, 0]
    target = factors @ matrix
    multipliers, _ = scipy.optimize.nnls(matrix.T, -target)
    nearest = target + multipliers @ matrix
    assert np.allclose(cone_batch(gradients, factors, np.zeros((1, dimension)))[0], nearest, atol=1e-8)


@given(problems(most=3), st.floats(0.1, 50))
def test_scale_may_go_in_before_the_projection(problem, scale):
    gradients, factors, nominal = problem
    for mode in ("none", "hierarchical", "cone"):
        once = np.array(PLANAR[mode](gradients, factors, nominal))
        scaled = np.array(PLANAR[mode](gradients, [scale * f for f in factors], nominal))
        assert np.allclose(scale * once, scaled, rtol=1e-9, atol=1e-7)


@given(problems(most=2))
def test_two_objectives_need_no_order(problem):
    gradients, factors, nominal = problem
    swapped = hierarchical(gradients[::-1], factors[::-1], nominal)
    assert np.allclose(hierarchical(gradients, factors, nominal), swapped, atol=1e-7)


def test_forward_and_right_give_forward_right_and_opposites_cancel():
    """The paper's own examples under Proposition 2."""
    assert harmonize([(0.0, 1.0), (1.0, 0.0)], [1.0, 1.0]) == (1.0, 1.0)
    for combine in (hierarchical, cone):
        assert combine([(0.0, 1.0), (0.0, -1.0)], [1.0, 1.0], (1.0, 0.0)) == pytest.approx((0.0, 0.0))


@given(planar_vector, planar_vector)
def test_eq_15_leaves_agreeing_guidance_alone(guidance, nominal):
    assume(np.dot(guidance, nominal) >= 0)
    assert project_onto_nominal(guidance, nominal) == guidance


@pytest.mark.parametrize("zeros", list(itertools.product([0.0, 1.0], repeat=3)))
def test_zero_gradients_and_zero_flow_are_harmless(zeros):
    first, second, flow = zeros
    gradients = [(first, 0.0), (-second, second)]
    for mode, combine in PLANAR.items():
        many = BATCH[mode](np.array(gradients)[:, None], np.ones(2), np.array([[0.0, flow]]))
        assert np.isfinite(combine(gradients, [1.0, 1.0], (0.0, flow))).all()
        assert np.isfinite(many).all()


def test_batched_projections_take_any_action_size():
    draw = np.random.default_rng(3)
    gradients, nominal = draw.standard_normal((3, 5, 4)), draw.standard_normal((5, 4))
    factors = np.ones(3)
    assert harmonize_batch(gradients, factors).shape == (5, 4)
    result = hierarchical_batch(gradients, factors, nominal)
    assert ((result * nominal).sum(-1) >= -1e-9).all()
