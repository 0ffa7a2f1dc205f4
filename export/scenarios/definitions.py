"""What the paper leaves open about its three tasks, in one place: objectives, time limits, thresholds.

The same for every method, and frozen: ``python -m benchmarks calibration`` chose the numbers by the
baselines' figures. ``benchmarks/results/paper/definitions.md`` tells how, and where flow policies had been
seen before.
"""

from dataclasses import dataclass, fields

from edge_runtime.objectives import (
    Clustering,
    Geofence,
    Objective,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
)


@dataclass(frozen=True, kw_only=True)
class Definition:
    """A task with two execution objectives."""

    steps: int
    """Time limit, in control steps of 0.1 s."""

    @property
    def objectives(self) -> tuple[Objective, ...]:
        """The individual's objective, then the team's."""
        values = [getattr(self, field.name) for field in fields(self)]
        return tuple(value for value in values if isinstance(value, Objective))


@dataclass(frozen=True, kw_only=True)
class NavigationDefinition(Definition):
    """Reach the goals within a speed limit and a safety margin."""

    speed_limit: SpeedLimit
    safety_margin: SafetyMargin
    tolerance: float
    """Share of an episode's steps in which an execution objective may be violated."""


@dataclass(frozen=True, kw_only=True)
class BalanceDefinition(Definition):
    """Bring the payload to its goal in a given order and at a given spacing."""

    spatial_order: SpatialOrder
    spacing: Spacing
    spacing_tolerance_m: float
    """How far a robot's closest neighbour may be from the wanted distance."""


@dataclass(frozen=True, kw_only=True)
class SamplingDefinition(Definition):
    """Gather samples as a cluster of a given radius, outside a fenced zone, to the end of the time."""

    geofence: Geofence
    clustering: Clustering
    enough_samples: float
    """Samples of the team that satisfy the nominal objective."""
    tolerance: float
    """Share of the steps in which a robot may be inside the zone."""
    cluster_tolerance_m: float
    """Root mean square deviation allowed from the wanted radius."""


NAVIGATION = NavigationDefinition(
    speed_limit=SpeedLimit(limit_m_s=0.3),
    safety_margin=SafetyMargin(distance_m=0.25),
    steps=150,
    tolerance=0.1,
)
BALANCE = BalanceDefinition(
    spatial_order=SpatialOrder(order=(1, 0, 3, 2, 4), gap_m=0.08, pull=2.0),
    spacing=Spacing(distance_m=0.15, weight=0.2),
    steps=300,
    spacing_tolerance_m=0.05,
)
SAMPLING = SamplingDefinition(
    geofence=Geofence(centre_m=(0.0, 0.0), radius_m=0.3),
    clustering=Clustering(radius_m=0.2),
    steps=150,
    enough_samples=60.0,
    tolerance=0.25,
    cluster_tolerance_m=0.15,
)

DEFINITIONS: dict[str, Definition] = {"navigation": NAVIGATION, "balance": BALANCE, "sampling": SAMPLING}
"""By scenario; what robots are asked at execution time, the same for every method."""
