"""What a MAVLink link is started with; travels as JSON to the guard process."""

import msgspec

from edge_runtime.messages import Vector2
from edge_runtime.motion.models import MotionModel


class MavlinkOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the link needs beyond the guard's own specification."""

    autopilot: str
    address: str
    motion: MotionModel
    """The policy's, integrated with the control period."""
    point_ahead_m: float = 0.0
    """Of a rover's axle: the point that is steered and reported; 0 refuses sideways velocities."""
    system_id: int = 1
    """The autopilot's MAVLink system."""
    source_system: int = 255
    """Ours; 255 is what ArduPilot's ground station failsafe watches by default."""
    origin_m: Vector2 = (0.0, 0.0)
    """East and north of the autopilot's local origin in the team's frame."""
    signing_key: str = ""
    """Key file; empty: neither sign nor ask for signatures."""
