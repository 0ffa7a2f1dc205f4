"""The page of motion models says what can be asked of which robot, as the code does."""

import re

import numpy as np
import pytest
from doc_pages import ROOT

from edge_runtime.guidance.slopes import action_slope
from edge_runtime.messages import RobotState, Teammate, TeamState, TrackedObject
from edge_runtime.motion.models import LinearTable, PointAcceleration, PointForce, Unicycle, VelocityLag
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.objectives import (
    BUILT_IN,
    Attraction,
    Clustering,
    Geofence,
    ObstacleMargin,
    Passing,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
    TrackedMargin,
)

PAGE = (ROOT / "docs" / "motion.md").read_text()
SECTION = PAGE.partition("## What can be asked")[2].partition("\n## ")[0]
ROWS = re.findall(r"^\| (`.*?) \| (.*?) \| (.*?) \|$", SECTION, re.MULTILINE)
ANSWERS = {name: (plane, space) for names, plane, space in ROWS for name in re.findall(r"`(\w+)`", names)}
NEAR = {
    SpeedLimit: SpeedLimit(limit_m_s=0.2),
    SafetyMargin: SafetyMargin(distance_m=0.5),
    SpatialOrder: SpatialOrder(order=(1, 0), gap_m=0.3),
    Spacing: Spacing(distance_m=0.5),
    Geofence: Geofence(centre_m=(0.4, 0.1), radius_m=0.5),
    Clustering: Clustering(radius_m=0.5),
    Passing: Passing(order=(1, 0), reach_m=0.6, clearance_m=0.4),
    ObstacleMargin: ObstacleMargin(distance_m=0.5),
    TrackedMargin: TrackedMargin(object="person", distance_m=0.5),
    Attraction: Attraction(object="person"),
}
"""Each asks for more than the robot of `scene` gives."""


def table(dims):
    rows = np.eye(dims) * 0.1 + 0.01
    gains = tuple(map(tuple, rows.tolist()))
    return LinearTable(
        0.1, (0.8,) * dims, gains, (0.08,) * dims, tuple(map(tuple, (0.5 * rows).tolist())), dims
    )


PLANE = (
    PointForce(1.0, 0.25, 0.1),
    PointForce(1.0, 0.25, 0.1, inertia_kg_m2=1.0),
    PointAcceleration(0.1),
    PointAcceleration(0.1, angular=True),
    VelocityLag(0.1),
    VelocityLag(0.1, time_constant_s=0.2, angular=True),
    Unicycle(0.1),
    Unicycle(0.1, forward="acceleration", turn="acceleration"),
    table(2),
)
SPACE = (
    PointForce(1.0, 0.25, 0.1, dims=3),
    PointAcceleration(0.1, dims=3, angular=True),
    VelocityLag(0.1, dims=3),
    table(3),
)


def scene(dims):
    """A robot that drives along x, with a teammate, a person and an obstacle close ahead."""
    own = RobotState(0, 0.0, (0.0, 0.0, 1.0)[:dims], (0.5, 0.0, 0.0)[:dims])
    mate = RobotState(1, 0.0, (0.3, 0.1, 1.1)[:dims], (0.0, 0.0, 0.0)[:dims])
    person = TrackedObject("person", 0.0, (0.3, -0.1, 0.9)[:dims], (0.0, 0.0, 0.0)[:dims])
    return own, mate, person


def test_the_page_answers_for_every_objective():
    assert (
        set(ANSWERS)
        == {kind.__struct_config__.tag for kind in BUILT_IN}
        == {NEAR[kind].name for kind in BUILT_IN}
    )


@pytest.mark.parametrize("kind", BUILT_IN, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("model", PLANE + SPACE, ids=repr)
def test_what_the_page_allows_steers_and_what_it_does_not_is_refused_in_a_line(model, kind):
    objective, dims = NEAR[kind], model.dims
    refused = objective.refuses(model)
    assert bool(refused) is ANSWERS[objective.name][dims - 2].startswith("no"), refused
    if refused:
        assert "\n" not in refused
        return
    own, mate, person = scene(dims)
    team = TeamState(own, (Teammate(mate, (0.0,) * model.action_dim),), tracked=(person,))
    outlook = look_ahead(team, model.preview(4), ((0.3, 0.0),), 0.4)
    cost, gradient = action_slope(objective, outlook, (0.5,) + (0.0,) * (model.action_dim - 1))
    assert cost > 0.0
    assert np.linalg.norm(gradient) > 1e-3
