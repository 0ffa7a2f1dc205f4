"""Where a robot learns of its teammates."""

from typing import Protocol

from edge_runtime.messages import Teammate


class FleetLink(Protocol):
    """A robot's view of its team."""

    def teammates(self) -> tuple[Teammate, ...]:
        """Return the newest state of every teammate heard so far, with its age. Never blocks."""
        ...
