"""An episode of a team in the built-in simulation, as fast as it computes."""

from collections.abc import Iterator

from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command
from edge_runtime.team.membership import LocalTeam
from firmware_bridge.simulation.bridge import SimBridge, SimFlags, open_bridge


def ticks(
    mission: Mission, duration_s: float, plant: str | None = None
) -> Iterator[tuple[SimBridge, Command]]:
    """Yield the team as each tick found it, and what the mission's robot then commanded.

    ``plant`` moves it instead of the fleet file's.
    """
    controller = mission.controller(mission.robot_id)
    with open_bridge(mission, SimFlags(plant)) as bridge:
        local = LocalTeam(bridge)
        for _ in range(round(duration_s * mission.rate_hz)):
            own = bridge.read()
            command = controller.decide(local.team(own), own.stamp_s)
            bridge.write(command)
            yield bridge, command
