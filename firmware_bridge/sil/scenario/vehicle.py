"""What the robots of a run are: a chassis on CAN, a rover on MAVLink."""

from typing import Literal

from firmware_bridge.can.profile import load_profile, profile_path

BridgeKind = Literal["can", "mavlink"]
PROFILE = "agilex_v2"
AUTOPILOT = "ardupilot_rover"
POINT_AHEAD_M = 0.2
"""MAVLink: the point that is steered, ahead of the rover's axle."""


def ahead_m(bridge: BridgeKind) -> float:
    """Return the distance from a base's axle to the point that it steers."""
    if bridge == "mavlink":
        return POINT_AHEAD_M
    return load_profile(profile_path(PROFILE)).base.reference_m
