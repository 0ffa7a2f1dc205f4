"""Propositions 2 and 3 as properties of the projections."""

import itertools

import numpy as np
import pytest
from guidance_cases import planar_vector, problems
from hypothesis import assume, given
from hypothesis import strategies as st

from edge_runtime.guidance.projection import COMBINE, cone, harmonize, hierarchical, project_onto_nominal


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


@given(problems(most=3), st.floats(0.1, 50))
def test_scale_may_go_in_before_the_projection(problem, scale):
    gradients, factors, nominal = problem
    for mode in ("none", "hierarchical", "cone"):
        once = np.array(COMBINE[mode](gradients, factors, nominal))
        scaled = np.array(COMBINE[mode](gradients, [scale * f for f in factors], nominal))
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
    for combine in COMBINE.values():
        assert np.isfinite(combine(gradients, [1.0, 1.0], (0.0, flow))).all()
