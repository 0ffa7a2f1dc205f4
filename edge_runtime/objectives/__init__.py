"""Execution objectives: what a team is asked while it drives, one objective a module.

To add one, subclass `Objective` and write ``evaluate``.
"""

from edge_runtime.objectives.attraction import Attraction
from edge_runtime.objectives.clustering import Clustering
from edge_runtime.objectives.geofence import Geofence
from edge_runtime.objectives.objective import LONGEST_LOOK_AHEAD, Objective, Slope
from edge_runtime.objectives.obstacle_margin import ObstacleMargin
from edge_runtime.objectives.passing import Passing
from edge_runtime.objectives.safety_margin import SafetyMargin
from edge_runtime.objectives.spacing import Spacing
from edge_runtime.objectives.spatial_order import SpatialOrder
from edge_runtime.objectives.speed_limit import SpeedLimit
from edge_runtime.objectives.tracked_margin import TrackedMargin

BUILT_IN = (
    SpeedLimit,
    SafetyMargin,
    SpatialOrder,
    Spacing,
    Geofence,
    Clustering,
    Passing,
    ObstacleMargin,
    TrackedMargin,
    Attraction,
)
"""The objectives that configuration files can name by their ``type``."""

__all__ = [
    "BUILT_IN",
    "LONGEST_LOOK_AHEAD",
    "Attraction",
    "Clustering",
    "Geofence",
    "Objective",
    "ObstacleMargin",
    "Passing",
    "SafetyMargin",
    "Slope",
    "Spacing",
    "SpatialOrder",
    "SpeedLimit",
    "TrackedMargin",
]
