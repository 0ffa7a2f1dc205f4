"""Every bridge that --bridge can name, and the modules that serve it; each is imported where it is chosen."""

from typing import Final, NamedTuple


class BridgeModules(NamedTuple):
    """One kind of link to a robot."""

    bridge: str
    """Offers ``add_arguments``, ``options_from`` and ``open_bridge``."""
    checks: str = ""
    """Offers ``examine_link(mission, options)`` for edge-doctor; empty where there is no link to look at."""
    guard_link: str = ""
    """Offers ``make_link(spec)`` for the guard's process; empty where nothing needs a guard."""
    simulated: bool = False
    """Whether the bridge also is the robot's team, see `edge_runtime.team.membership.FleetLink`."""


_ROS: Final = BridgeModules(
    "firmware_bridge.ros.bridge",
    checks="firmware_bridge.ros.diagnostics",
    guard_link="firmware_bridge.ros.link",
)
BRIDGES: Final = {
    "sim": BridgeModules("firmware_bridge.simulation.bridge", simulated=True),
    "can": BridgeModules(
        "firmware_bridge.can.bridge",
        checks="firmware_bridge.can.diagnostics",
        guard_link="firmware_bridge.can.link",
    ),
    "mavlink": BridgeModules(
        "firmware_bridge.mavlink.bridge",
        checks="firmware_bridge.mavlink.diagnostics",
        guard_link="firmware_bridge.mavlink.link",
    ),
    "ros1": _ROS,
    "ros2": _ROS,
}
