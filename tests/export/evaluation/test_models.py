"""Every objective on every motion model: the one gradient checker, and many robots at once against one."""

import numpy as np
import pytest
from guidance_cases import guide_for, random_team
from motion_models import EXAMPLES
from msgspec.structs import replace
from team_batches import as_batch

from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import check_objectives
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.guidance.slopes import action_slope
from edge_runtime.messages import TrackedObject
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.objectives import (
    BUILT_IN,
    Attraction,
    Clustering,
    Geofence,
    Objective,
    ObstacleMargin,
    Passing,
    SafetyMargin,
    Slope,
    Spacing,
    SpatialOrder,
    SpeedLimit,
    TrackedMargin,
)
from edge_runtime.objectives.gradient_check import check_gradient
from export.evaluation.guidance import action_slopes
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import look_ahead_batch


class LookNorth(Objective, frozen=True, kw_only=True, tag="look_north"):
    """A user's own, of what turns."""

    def evaluate(self, motion, outlook):
        off = motion.heading - 0.5 * np.pi
        return Slope(
            0.5 * (off * off + motion.yaw_rate * motion.yaw_rate), d_heading=off, d_yaw_rate=motion.yaw_rate
        )


class Ceiling(Objective, frozen=True, kw_only=True, tag="ceiling"):
    """A user's own, of what flies."""

    height_m: float

    def evaluate(self, motion, outlook):
        cure = max(0.0, motion.z + 0.1 * motion.vz - self.height_m) / outlook.preview.position_gain
        slope = cure / outlook.preview.position_gain
        return Slope(0.5 * cure * cure, d_z=slope, d_vz=0.1 * slope)


OBJECTIVES = [
    SpeedLimit(limit_m_s=0.2, look_ahead=2),
    SafetyMargin(distance_m=0.5),
    SpatialOrder(order=(1, 0, 3, 2), gap_m=0.2),
    Spacing(distance_m=0.3),
    Geofence(centre_m=(0.1, -0.05), radius_m=0.4),
    Geofence(centre_m=(0.1, -0.05, 0.1), radius_m=0.5),
    Clustering(radius_m=0.2),
    Passing(order=(1, 0, 3, 2), reach_m=1.0, clearance_m=0.3),
    ObstacleMargin(distance_m=0.4),
    TrackedMargin(object="person", distance_m=0.4),
    Attraction(object="person", pull=3.0),
    LookNorth(look_ahead=3),
    Ceiling(height_m=0.1),
]
NAMED = pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: f"{o.name}-{len(str(o))}")
EVERY = pytest.mark.parametrize("name", EXAMPLES)


def has_it(objective, model):
    """Whether a user's own cost depends on something that the model has at all."""
    return {LookNorth: model.turns, Ceiling: model.dims == 3}.get(type(objective), True)


def person(draw, model):
    place, speed = draw.uniform(-0.4, 0.4, (2, model.dims)).tolist()
    return (TrackedObject("person", 0.0, tuple(place), tuple(speed), *draw.uniform(-1.0, 1.0, 2).tolist()),)


def test_every_objective_is_tried():
    assert set(BUILT_IN) <= set(map(type, OBJECTIVES))


@NAMED
@EVERY
def test_every_gradient_is_that_of_its_cost_or_the_objective_is_refused(objective, name):
    model = EXAMPLES[name]
    if objective.refuses(model):
        with pytest.raises(ConfigError, match=f"objectives.0.: {objective.name} cannot be used with motion"):
            check_objectives(ObjectiveSet((objective,)), model)
    elif has_it(objective, model):
        assert check_gradient(objective, model, motions=100).active > 5


@NAMED
@EVERY
def test_many_robots_at_once_are_told_what_each_is(objective, name):
    model = EXAMPLES[name]
    if objective.refuses(model) or isinstance(objective, ObstacleMargin):
        return
    draw, rows = np.random.default_rng(3), 60
    teams = [
        replace(random_team(draw, ids=draw.permutation(4).tolist(), model=model), tracked=person(draw, model))
        for _ in range(rows)
    ]
    action = draw.uniform(-1.0, 1.0, (rows, model.action_dim))
    guide = guide_for([objective], model)
    outlook = look_ahead_batch(as_batch(teams), guide.previews[0], guide.horizons_s[0])
    cost = evaluate_batch(objective, outlook.at(action)[0], outlook).cost
    _, (gradients,) = action_slopes(guide, [outlook], action)
    for row, team in enumerate(teams):
        ahead = look_ahead(team, guide.previews[0], horizon_s=guide.horizons_s[0])
        alone = action_slope(objective, ahead, action[row].tolist())
        np.testing.assert_allclose([cost[row], *gradients[row]], [alone[0], *alone[1]], rtol=1e-9, atol=1e-9)
    assert gradients.any() == has_it(objective, model)


@pytest.mark.parametrize(
    ("objective", "name", "why"),
    [
        (OBJECTIVES[7], "drone", "in space: robots in space pass above and below"),
        (
            ObstacleMargin(distance_m=0.2),
            "turning drone",
            "in space: its range sensor sees in the plane",
        ),
        (
            OBJECTIVES[5],
            "unicycle",
            "its centre_m has a height, and the robot moves in the plane",
        ),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_what_a_robot_cannot_be_asked_is_said_in_one_line(objective, name, why):
    with pytest.raises(ConfigError, match=why) as raised:
        guide_for([objective], EXAMPLES[name])
    assert "\n" not in str(raised.value)
