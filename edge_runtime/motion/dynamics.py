"""The names under which other modules know the motion of a point that forces push in the plane."""

from typing import TYPE_CHECKING

from edge_runtime.motion.linear import PlanarPreview as Preview
from edge_runtime.motion.point import PointForce

if TYPE_CHECKING:

    class Dynamics(PointForce, frozen=True):
        """What is known of a `PointForce` of the plane without inertia."""

        def preview(self, steps: int) -> Preview:
            """See `Model.preview`."""

        def at_period(self, period_s: float) -> "Dynamics":
            """See `Model.at_period`."""

        def scaled(self, scale_m: float) -> "Dynamics":
            """See `Model.scaled`."""
else:
    Dynamics = PointForce

__all__ = ["Dynamics", "Preview"]
