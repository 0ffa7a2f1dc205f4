"""What each task's robots are asked at execution time: Table I's objectives, the same for every method."""

from edge_runtime.objectives import (
    Clustering,
    Geofence,
    Objective,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
)

EXECUTION_OBJECTIVES: dict[str, tuple[Objective, ...]] = {
    "balance": (SpatialOrder(order=(1, 0, 3, 2, 4), gap_m=0.08), Spacing(distance_m=0.15)),
    "navigation": (SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)),
    "sampling": (Geofence(centre_m=(0.0, 0.0), radius_m=0.3), Clustering(radius_m=0.3)),
}
"""By scenario: the individual's objective, then the team's."""

NOMINAL_STEP: dict[str, float] = {"balance": 0.5, "navigation": 0.1, "sampling": 0.85}
"""Nominal reward of a robot in one step of good work: the unit in which PC-MAPPO weighs the task."""
