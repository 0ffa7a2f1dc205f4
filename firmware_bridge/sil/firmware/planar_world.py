"""The harness's own world: the manifests' motion models, VMAS's contacts, wheels that turn."""

from collections.abc import Sequence

from edge_runtime.config.fleet import Fleet, Obstacle
from edge_runtime.motion.range_sensor import Disc
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.kinematics.frames import rotate, wrap
from firmware_bridge.sil.firmware.following import Wanted, follower
from firmware_bridge.sil.firmware.world import Standing, World
from firmware_bridge.simulation.plant import Plant


class PlanarWorld(World):
    """N robots, at rest, see `firmware_bridge.simulation.plant.Plant`.

    Args:
        manifests: motion model, body and action limits of each robot.
        standings: of each.
        period_s: of one step.
        scale_m: one of the policy's metres, in the robots'.
        follow_s: the period within which firmware makes its motion what it was told; a step's where None.
        obstacles: in their way.
    """

    def __init__(
        self,
        manifests: Sequence[Manifest],
        standings: Sequence[Standing],
        period_s: float,
        scale_m: float = 1.0,
        follow_s: float | None = None,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        super().__init__(standings, [manifest.body.radius_m for manifest in manifests])
        self._period_s = period_s
        self._follow = [follower(manifest, follow_s or period_s) for manifest in manifests]
        self.plant = Plant(
            [manifest.motion.at_period(period_s) for manifest in manifests],
            self.radius_m,
            self.position_m,
            obstacles,
            scale_m=scale_m,
            heading_rad=self.heading_rad,
        )
        self.position_m, self.velocity_m_s = self.plant.position_m, self.plant.velocity_m_s
        self.heading_rad, self.yaw_rate_rad_s = self.plant.heading_rad, self.plant.yaw_rate_rad_s

    def step(self, motions: Sequence[BaseMotion]) -> None:
        """Advance one period while each robot follows what it was told."""
        self.plant.step([self.action(robot, motion) for robot, motion in enumerate(motions)])
        self.turn()

    def obstacles(self) -> Sequence[Disc]:
        """As they are now."""
        return self.plant.obstacles()

    def action(self, robot: int, told: BaseMotion) -> tuple[float, ...]:
        """The action by which the robot's disc comes to move as its base was told."""
        ahead_m = self.ahead_m[robot]
        body = (told.forward_m_s, ahead_m * told.yaw_rad_s if ahead_m else told.lateral_m_s)
        velocity = rotate(body, float(self.heading_rad[robot]))
        return self._follow[robot](self.plant.state(robot, robot, 0.0), Wanted(*velocity, told.yaw_rad_s))

    def turn(self) -> None:
        """Turn the bases that steer a point ahead of their axle, as it has moved."""
        for robot, ahead_m in enumerate(self.ahead_m):
            if ahead_m:
                turned = wrap(
                    float(self.heading_rad[robot]) + self._period_s * self._sideways(robot) / ahead_m
                )
                self.heading_rad[robot] = turned
                self.yaw_rate_rad_s[robot] = self._sideways(robot) / ahead_m

    def _sideways(self, robot: int) -> float:
        """How fast the disc moves to its base's left."""
        return rotate(self.velocity_m_s[robot].tolist(), -float(self.heading_rad[robot]))[1]


def make_world(
    fleet: Fleet,
    manifests: Sequence[Manifest],
    standings: Sequence[Standing],
    period_s: float,
    control_s: float,
) -> World:
    """Make the world of a fleet's robots.

    Args:
        fleet: as the robots see it.
        manifests: of what they run, in its order.
        standings: of each.
        period_s: of a step.
        control_s: the control period.
    """
    del control_s  # the firmware follows from step to step
    return PlanarWorld(manifests, standings, period_s, fleet.team.scale_m, obstacles=fleet.obstacles)
