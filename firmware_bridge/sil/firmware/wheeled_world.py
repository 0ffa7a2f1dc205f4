"""The harness's world in MuJoCo: wheels that slip under what the robots' firmware was told."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from edge_runtime.config.fleet import Fleet
from edge_runtime.messages import Vector2
from edge_runtime.motion.range_sensor import Disc
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.kinematics.frames import rotate
from firmware_bridge.sil.firmware.world import Standing, World
from firmware_bridge.simulation.wheels.bases import BASES
from firmware_bridge.simulation.wheels.team import WheeledTeam


class WheeledWorld(World):
    """N robots on the fleet's base, at rest.

    Args:
        fleet: names base, friction, payload and obstacles.
        manifests: body of each robot.
        standings: of each.
        period_s: of one step.
    """

    def __init__(
        self, fleet: Fleet, manifests: Sequence[Manifest], standings: Sequence[Standing], period_s: float
    ) -> None:
        super().__init__(standings, [manifest.body.radius_m for manifest in manifests])
        settings, self._period_s = fleet.simulation, period_s
        middles: list[Vector2] = []
        for (x, y), heading, ahead_m in standings:
            ahead = rotate((ahead_m, 0.0), heading)
            middles.append((x - ahead[0], y - ahead[1]))
        headings = [standing.heading_rad for standing in standings]
        self.team = WheeledTeam(
            BASES[settings.base], middles, headings, settings.friction, settings.payload_kg, fleet.obstacles
        )
        self._look()

    def step(self, motions: Sequence[BaseMotion]) -> None:
        """Advance one period while each wheel controller follows what it was told."""
        self.team.step(motions, self._period_s)
        self._look()

    def touching(self) -> npt.NDArray[np.bool_]:
        """Which bases have touched so far (N, N): a contact of wheels and corners flickers."""
        robots = self._touched()[:, : len(self.ahead_m)]
        return robots | robots.T

    def bumping(self) -> npt.NDArray[np.bool_]:
        """Which bases have touched which obstacles so far (N, M)."""
        return self._touched()[:, len(self.ahead_m) :]

    def obstacles(self) -> Sequence[Disc]:
        """As they are now."""
        return self.team.obstacles()

    def _touched(self) -> npt.NDArray[np.bool_]:
        """(N, N + M), each pair once: robots, then obstacles."""
        touched = np.zeros((len(self.ahead_m), len(self.ahead_m) + len(self.obstacles())), bool)
        for pair in self.team.touched:
            touched[pair] = True
        return touched

    def _look(self) -> None:
        """Where the points are that the bases steer, and how they move."""
        for robot, ahead_m in enumerate(self.ahead_m):
            state = self.team.state(robot)
            x, y = rotate((ahead_m, 0.0), state.heading_rad)
            left_m_s = state.left_m_s + ahead_m * state.yaw_rad_s
            self.position_m[robot] = state.position_m[0] + x, state.position_m[1] + y
            self.velocity_m_s[robot] = rotate((state.forward_m_s, left_m_s), state.heading_rad)
            self.heading_rad[robot], self.yaw_rate_rad_s[robot] = state.heading_rad, state.yaw_rad_s


def make_world(
    fleet: Fleet,
    manifests: Sequence[Manifest],
    standings: Sequence[Standing],
    period_s: float,
    control_s: float,
) -> World:
    """See `firmware_bridge.sil.firmware.planar_world.make_world`."""
    del control_s  # wheel controllers know no period
    return WheeledWorld(fleet, manifests, standings, period_s)
