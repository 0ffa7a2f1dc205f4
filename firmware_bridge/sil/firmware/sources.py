"""The streams of a run: poses of robots and tracked objects, and sensors, as the world knows them."""

import math
import random
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from edge_runtime.common.closing import Closing
from edge_runtime.config.fleet import Fleet
from edge_runtime.config.keys import team_key
from edge_runtime.config.network import endpoint
from edge_runtime.motion.range_sensor import RangeSensor
from edge_runtime.network.stream_wire import Kind
from edge_runtime.tools.pose.stream_host import StreamHost
from firmware_bridge.sil.firmware.world import World

NOISE_M: Final = 1e-4
"""Deviation of positions told at a rate of their own, as motion capture has; it also tells one pose from the
next where a robot rests."""


class Sources(Closing):
    """Tells each robot what its fleet file has from a stream; a context manager that lets the socket go.

    Args:
        fleet: as the robots see it; all its streams come from one place, or it has none.
        world: knows.
        on_pose: called with a robot's id, and when and where (x in m) a pose of its was measured.
        rate_hz: of streams with a rate of their own; 0: they are told when `tell` is called.
        start_s: monotonic time of the first of these.
        range_sensors: of the robots, where any hear theirs.
    """

    def __init__(
        self,
        fleet: Fleet,
        world: World,
        on_pose: Callable[[int, float, float], object] = lambda *_: None,
        rate_hz: float = 0.0,
        start_s: float = 0.0,
        range_sensors: Sequence[RangeSensor] = (),
    ) -> None:
        self.due_s = start_s if rate_hz else math.inf
        """When the streams are to be told next."""
        self._fleet, self._world, self._on_pose = fleet, world, on_pose
        self._rate_hz, self._draw = rate_hz, random.Random(0)
        self._range_sensors = range_sensors
        self._told = [(place, robot) for place, robot in enumerate(fleet.robots) if robot.pose_place]
        self._seeing = [(place, robot) for place, robot in enumerate(fleet.robots) if robot.ranges_place]
        places = {robot.pose_place for _, robot in self._told}
        places |= {robot.ranges_place for _, robot in self._seeing}
        self._host = None
        if place := next(iter(places), None):
            addresses = {robot.id: endpoint(robot.address) for robot in fleet.robots if robot.address}
            self._host = StreamHost(
                place,
                addresses,
                [robot.id for _, robot in self._told],
                [robot.id for _, robot in self._seeing],
                team_key(fleet),
                [each.name for each in fleet.tracked],
                [(robot.id, name) for robot in fleet.robots for name in robot.sensors],
            )

    def close(self) -> None:
        """Let the socket go."""
        if self._host:
            self._host.close()

    def tell_due(self, now_s: float) -> None:
        """Tell it if the streams have a rate of their own and it is time to."""
        if now_s >= self.due_s:
            self.due_s += (math.floor((now_s - self.due_s) * self._rate_hz) + 1) / self._rate_hz
            self.tell(now_s)

    def tell(self, now: float) -> None:
        """Tell everybody who asks how everything is now."""
        host, world = self._host, self._world
        if host is None:
            return
        host.listen()
        for place, robot in self._told:
            base, moved, speed = world.state(place), world.position_m[place], world.velocity_m_s[place]
            where = [value + self._noise() for value in moved.tolist()]
            values = (*where, *speed.tolist(), base.heading_rad, base.yaw_rad_s)
            host.publish(Kind.POSE, robot.id, now, values)
            self._on_pose(robot.id, now, where[0])
            for name in robot.sensors:
                host.publish(Kind.SENSOR, robot.id, now, world.reading(place, name), name)
        for place, robot in self._seeing:
            host.publish(Kind.RANGES, robot.id, now, self._ranges_m(place))
        for each, motion in zip(self._fleet.tracked, world.objects(), strict=True):
            values = (*motion.position_m, *motion.velocity_m_s)
            host.publish_object(each.name, now, (*values, motion.heading_rad, motion.yaw_rate_rad_s))

    def _ranges_m(self, place: int) -> tuple[float, ...]:
        """What the robot's range sensor reads of the others and of obstacles."""
        sensor = self._range_sensors[place]
        own, *others = np.roll(self._world.position_m, -place, 0).tolist()
        return tuple(sensor.readings(own, [*sensor.discs(own, others), *self._world.obstacles()]))

    def _noise(self) -> float:
        return self._draw.gauss(0.0, NOISE_M) if self._rate_hz else 0.0
