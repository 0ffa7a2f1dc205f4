"""How long and how far each robot still goes after a fault that is to stop it, as the plant knows it."""

from collections.abc import Sequence

from firmware_bridge.sil.firmware.world import World
from firmware_bridge.sil.report.records import FaultStop
from firmware_bridge.sil.scenario.faults import AnyFault, Blackout

SLOWEST_M_S = 1e-3
"""Slower counts as standing."""


class _Way:
    """One robot's, from a fault until it rests."""

    def __init__(self, robot_id: int) -> None:
        self.robot_id, self.metres = robot_id, 0.0
        self.rest_s: float | None = None


class Stops:
    """Follows the plant step by step.

    Args:
        world: the plant.
        robots: ids in its order.
        faults: the timeline; those that stop nobody are passed over.
        period_s: of one step.
    """

    def __init__(
        self, world: World, robots: Sequence[int], faults: Sequence[AnyFault], period_s: float
    ) -> None:
        self._world, self._period_s = world, period_s
        self._index = {robot_id: index for index, robot_id in enumerate(robots)}
        self._ways = [(fault.at_s, [_Way(robot) for robot in self._struck(fault)]) for fault in faults]

    def follow(self, elapsed_s: float) -> None:
        """Take the step just done into account."""
        speeds = self._world.speeds_m_s()
        for at_s, ways in self._ways:
            for way in ways if at_s <= elapsed_s else ():
                speed = float(speeds[self._index[way.robot_id]])
                if way.rest_s is None and speed < SLOWEST_M_S:
                    way.rest_s = elapsed_s - at_s
                elif way.rest_s is None:
                    way.metres += speed * self._period_s

    def stops(self) -> tuple[tuple[FaultStop, ...], ...]:
        """Return what was seen, in the order of the timeline."""
        return tuple(
            tuple(FaultStop(way.robot_id, way.rest_s, way.metres) for way in ways) for _, ways in self._ways
        )

    def _struck(self, fault: AnyFault) -> Sequence[int]:
        """Whom a fault is to stop: whom it takes out, or leaves without a team."""
        return (fault.robots or tuple(self._index)) if isinstance(fault, Blackout) else fault.hits
