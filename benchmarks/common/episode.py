"""An episode of a team in the built-in simulation, as fast as it computes."""

from collections.abc import Iterator

from edge_runtime.control.mission import Mission
from edge_runtime.messages import Command, TeamState
from firmware_bridge.simulation.bridge import SimBridge, open_bridge


def ticks(mission: Mission, duration_s: float) -> Iterator[tuple[SimBridge, Command]]:
    """Yield the team as each tick found it, and what the mission's robot then commanded."""
    controller = mission.controller(mission.robot_id)
    with open_bridge(mission) as bridge:
        for _ in range(round(duration_s * mission.rate_hz)):
            own = bridge.read()
            team = TeamState(own, bridge.teammates(), ranges_m=bridge.ranges_m())
            command = controller.decide(team, own.stamp_s)
            bridge.write(command)
            yield bridge, command
