"""What tuning asks: as the evaluation in kind, never near it in value."""

from dataclasses import fields

import pytest

from edge_runtime.objectives import Attraction, Passing, SpatialOrder
from export.episodes.varied import SHARE_AROUND, varied
from export.scenarios.definitions import DEFINITIONS

SEEDS = range(40)
NUMBERS = ("limit_m_s", "distance_m", "gap_m", "radius_m")


def numbers(objective):
    return {name: getattr(objective, name) for name in NUMBERS if hasattr(objective, name)}


@pytest.mark.parametrize("task", DEFINITIONS)
def test_what_tuning_asks_leaves_the_evaluations_values_out(task):
    for seed in SEEDS:
        drawn = varied(task, seed).definition
        for usual, other in zip(DEFINITIONS[task].objectives, drawn.objectives, strict=True):
            for name, value in numbers(other).items():
                assert abs(value / getattr(usual, name) - 1.0) >= SHARE_AROUND - 1e-9
            if isinstance(other, SpatialOrder):
                assert sorted(other.order) == sorted(usual.order)
                assert other.order not in (usual.order, tuple(sorted(usual.order)))


@pytest.mark.parametrize("task", DEFINITIONS)
def test_all_else_is_the_tasks_own_and_the_seed_decides(task):
    drawn, again, other = varied(task, 3), varied(task, 3), varied(task, 4)
    assert drawn == again != other
    objectives = {id(each) for each in drawn.definition.objectives}
    for field in fields(drawn.definition):
        value = getattr(drawn.definition, field.name)
        assert id(value) in objectives or value == getattr(DEFINITIONS[task], field.name)


@pytest.mark.parametrize("task", DEFINITIONS)
def test_robots_are_guided_to_what_is_judged(task):
    drawn = varied(task, 5)
    judged = {type(each): each for each in drawn.definition.objectives}
    for guiding in drawn.asked.objectives:
        if isinstance(guiding, Passing):
            assert guiding.order == judged[SpatialOrder].order
        elif not isinstance(guiding, Attraction):  # which draws to samples, and nobody is judged by it
            assert numbers(guiding) == numbers(judged[type(guiding)])
