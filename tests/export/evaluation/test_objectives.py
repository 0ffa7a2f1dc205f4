"""Every objective's cost and slope at B motions against one motion at a time, degenerate teams included."""

import numpy as np
import pytest
from guidance_cases import DYNAMICS

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
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import MotionBatch, TeamBatch, look_ahead_batch


class StayNorth(Objective, frozen=True, kw_only=True, tag="stay_north"):
    """A user's own."""

    line_m: float

    def evaluate(self, motion, outlook):
        depth = max(0.0, self.line_m - motion.y) / outlook.preview.position_gain
        return Slope(0.5 * depth * depth, d_y=-depth / outlook.preview.position_gain)


class HalfAsFast(SpeedLimit, frozen=True, kw_only=True, tag="half_as_fast"):
    """A user's own, made of a built-in one."""

    def evaluate(self, motion, outlook):
        return Slope(*(0.5 * part for part in super().evaluate(motion, outlook)))


OBJECTIVES = [
    SpeedLimit(limit_m_s=0.3),
    SpeedLimit(limit_m_s=0.1, look_ahead=4),
    SafetyMargin(distance_m=0.25),
    SafetyMargin(distance_m=0.6, look_ahead=8),
    SpatialOrder(order=(1, 0, 3, 2, 4, 5), gap_m=0.1),
    SpatialOrder(order=(2, 0, 1), gap_m=0.3, pull=20.0, look_ahead=1),
    Spacing(distance_m=0.15),
    Spacing(distance_m=0.5, look_ahead=1),
    Geofence(centre_m=(0.1, -0.05), radius_m=0.3),
    Clustering(radius_m=0.2),
    Clustering(radius_m=0.5, look_ahead=1),
    Passing(order=(1, 0, 3, 2, 4, 5), reach_m=1.0, clearance_m=0.3),
    Passing(order=(2, 0, 1), reach_m=0.6, margin_m=0.1, clearance_m=0.4, pull=0.5, look_ahead=1),
    TrackedMargin(object="person", distance_m=0.3),
    TrackedMargin(object="person", distance_m=0.6, look_ahead=1),
    Attraction(object="person"),
    Attraction(object="person", pull=9.0, look_ahead=1),
    StayNorth(line_m=0.1),
    HalfAsFast(limit_m_s=0.3),
]


def random_teams(mates, extent_m, rows=200):
    draw = np.random.default_rng(2)
    ids = np.stack([draw.permutation(mates + 1) for _ in range(rows)])
    position, velocity, action = draw.uniform(-extent_m, extent_m, (3, rows, mates + 1, 2))
    return TeamBatch(
        robot_id=ids[:, 0],
        own=MotionBatch.of(position[:, 0], velocity[:, 0]),
        mate_id=ids[:, 1:],
        mates=MotionBatch.of(position[:, 1:], velocity[:, 1:]),
        mate_action=action[:, 1:],
        tracked={"person": MotionBatch.of(*draw.uniform(-extent_m, extent_m, (2, rows, 2)))},
    )


def both(objective, team):
    """Tables (B, 5) of cost and slope, of all motions at once and one by one."""
    horizon_s = objective.look_ahead * DYNAMICS.dt_s
    outlook = look_ahead_batch(team, DYNAMICS.preview(objective.look_ahead), horizon_s)
    batch = evaluate_batch(objective, outlook.drift, outlook)
    rows = [outlook.row(i) for i in range(len(team.robot_id))]
    singles = [objective.evaluate(row.drift, row) for row in rows]
    return np.concatenate([batch.cost[:, None], batch.d_motion], 1), np.array(singles)


def test_every_objective_is_tried():
    """But the one over readings of ranges, which teams of an evaluation do not have."""
    assert set(BUILT_IN) - {ObstacleMargin} <= set(map(type, OBJECTIVES))


@pytest.mark.parametrize("mates", [0, 1, 4])
@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: f"{o.name}-{o.look_ahead}")
def test_batched_and_single_agree(objective, mates):
    many, ones = both(objective, random_teams(mates, 0.4))
    np.testing.assert_allclose(many, ones, rtol=1e-9, atol=1e-9)
    assert not mates or ones.any()


@pytest.mark.parametrize(
    "objective", [TrackedMargin(object="door", distance_m=9.0), Attraction(object="door")]
)
def test_an_object_that_nobody_tracks_costs_nothing(objective):
    many, ones = both(objective, random_teams(1, 0.4))
    assert not many.any() and not ones.any()


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda o: f"{o.name}-{o.look_ahead}")
def test_robots_that_coincide_are_parted_alike(objective):
    """All at one place, in the middle of the fence where there is one: only their numbers tell them apart."""
    team = random_teams(2, 0.0, rows=6)
    centre = getattr(objective, "centre_m", (0.0, 0.0))
    team.own.position_m[:], team.mates.position_m[:] = centre, centre
    team.tracked["person"].position_m[:] = centre
    many, ones = both(objective, team)
    np.testing.assert_allclose(many, ones, rtol=1e-12, atol=1e-9)
    assert np.isfinite(many).all()
