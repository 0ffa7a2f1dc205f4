"""The streams of a run: poses of robots and tracked objects, and sensors, as the world knows them."""

import time
from types import TracebackType

from edge_runtime.config.fleet import Fleet
from edge_runtime.config.keys import team_key
from edge_runtime.config.network import endpoint
from edge_runtime.network.stream_wire import Kind
from edge_runtime.tools.pose.stream_host import StreamHost
from firmware_bridge.sil.firmware.world import World


class Sources:
    """Tells each robot what its fleet file has from a stream; a context manager that lets the socket go.

    Args:
        fleet: as the robots see it; all its streams come from one place, or it has none.
        world: knows.
    """

    def __init__(self, fleet: Fleet, world: World) -> None:
        self._fleet, self._world = fleet, world
        self._told = [(place, robot) for place, robot in enumerate(fleet.robots) if robot.pose_place]
        places = {robot.pose_place for _, robot in self._told}
        self._host = None
        if place := next(iter(places), None):
            addresses = {robot.id: endpoint(robot.address) for robot in fleet.robots if robot.address}
            self._host = StreamHost(
                place,
                addresses,
                [robot.id for _, robot in self._told],
                (),
                team_key(fleet),
                [each.name for each in fleet.tracked],
                [(robot.id, name) for robot in fleet.robots for name in robot.sensors],
            )

    def __enter__(self) -> "Sources":
        """Listen already."""
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Let the socket go."""
        if self._host:
            self._host.close()

    def tell(self) -> None:
        """Tell everybody who asks how everything is now."""
        host, world, now = self._host, self._world, time.monotonic()
        if host is None:
            return
        host.listen()
        for place, robot in self._told:
            base, moved, speed = world.state(place), world.position_m[place], world.velocity_m_s[place]
            values = (*moved.tolist(), *speed.tolist(), base.heading_rad, base.yaw_rad_s)
            host.publish(Kind.POSE, robot.id, now, values)
            for name in robot.sensors:
                host.publish(Kind.SENSOR, robot.id, now, world.reading(place, name), name)
        for each, motion in zip(self._fleet.tracked, world.objects(), strict=True):
            values = (*motion.position_m, *motion.velocity_m_s)
            host.publish_object(each.name, now, (*values, motion.heading_rad, motion.yaw_rate_rad_s))
