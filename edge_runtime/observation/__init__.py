"""Sources of the policy's input: each says where one field of the observation comes from.

To add one, subclass `Source` and write ``read``.
"""

from typing import get_args

from edge_runtime.observation.goal import Constant, GoalOffset, TimeLeft
from edge_runtime.observation.own_motion import Heading, Position, PreviousAction, Velocity, YawRate
from edge_runtime.observation.own_source import OwnSource
from edge_runtime.observation.ranges import Proximity, Ranges, Sensor
from edge_runtime.observation.source import Extent, Frame, Source, SourceError, View
from edge_runtime.observation.teammates import TeammateOffsets, TeammatesPresent, TeammateVelocities
from edge_runtime.observation.tracked import (
    Tracked,
    TrackedGoalOffset,
    TrackedHeading,
    TrackedOffset,
    TrackedVelocity,
    TrackedYawRate,
)

ObservationField = (
    Position
    | Velocity
    | Heading
    | YawRate
    | PreviousAction
    | GoalOffset
    | TimeLeft
    | Constant
    | TeammateOffsets
    | TeammateVelocities
    | TeammatesPresent
    | Ranges
    | Proximity
    | Sensor
    | TrackedOffset
    | TrackedGoalOffset
    | TrackedVelocity
    | TrackedHeading
    | TrackedYawRate
    | OwnSource
)
"""One contiguous piece of the observation vector, as a manifest states it; told by its ``source``."""
SOURCES = get_args(ObservationField)
"""Every source that a manifest can name."""

__all__ = [
    "SOURCES",
    "Constant",
    "Extent",
    "Frame",
    "GoalOffset",
    "Heading",
    "ObservationField",
    "OwnSource",
    "Position",
    "PreviousAction",
    "Proximity",
    "Ranges",
    "Sensor",
    "Source",
    "SourceError",
    "TeammateOffsets",
    "TeammateVelocities",
    "TeammatesPresent",
    "TimeLeft",
    "Tracked",
    "TrackedGoalOffset",
    "TrackedHeading",
    "TrackedOffset",
    "TrackedVelocity",
    "TrackedYawRate",
    "Velocity",
    "View",
    "YawRate",
]
