"""The policy's input, composed in the order of the manifest's fields: SI units, the team's frame.

``goal_offset`` is position minus goal. ``ranges`` are the sensor's readings, ``proximity`` its range minus
its readings, so that free space is zero. Without a real sensor the readings are computed from the
teammates' discs as VMAS 1.5.2 computes them: rays point along fixed directions of the team's frame and
start at the robot's centre; a disc counts only if its centre lies ahead; the reading is the first crossing
with its rim, below zero where the ray starts inside the disc, and never above the sensor's range.
"""

import math
from collections.abc import Sequence

import numpy as np

from edge_runtime.common.arrays import Array, Floats
from edge_runtime.errors import PolicyError
from edge_runtime.messages import TeamState, Vector2
from edge_runtime.policy.manifest import Body, Manifest

SOURCES = ("position", "velocity", "goal_offset", "proximity", "ranges")
"""The fields that can be composed here; a policy with others runs only where its simulation observes."""


class Observer:
    """Composes one robot's observations; the returned array is reused by the next call.

    Args:
        manifest: names the fields and the robot's body; already checked.
        goal_m: where the robot is to go.

    Raises:
        PolicyError: if the policy observes something that has no source here.
    """

    def __init__(self, manifest: Manifest, goal_m: Vector2) -> None:
        check_sources(manifest)
        self.goal_m = goal_m
        self._body = manifest.body
        self._fields = tuple(field.name for field in manifest.observation)
        self._rays: list[Vector2] = [(x, y) for x, y in ray_directions(manifest.body).tolist()]
        self._vector = np.zeros((1, manifest.observation_dim), np.float32)

    def observe(self, team: TeamState) -> Array:
        """Compose the observation (1, O) of what the robot knows of itself and its teammates.

        Raises:
            PolicyError: if the number of readings is not the number of rays.
        """
        position, velocity = team.own.position_m, team.own.velocity_m_s
        ranges_m: Sequence[float] | None = team.ranges_m
        if ranges_m is None:
            mates = [mate.state.position_m for mate in team.teammates + team.silent]
            ranges_m = disc_ranges(position, mates, self._rays, self._body)
        elif len(ranges_m) != len(self._rays):
            raise PolicyError(f"got {len(ranges_m)} ranges, the policy's sensor has {len(self._rays)} rays")
        reach = self._body.lidar_range_m
        parts: dict[str, Sequence[float]] = {
            "position": position,
            "velocity": velocity,
            "goal_offset": (position[0] - self.goal_m[0], position[1] - self.goal_m[1]),
            "proximity": [reach - reading for reading in ranges_m],
            "ranges": ranges_m,
        }
        self._vector[0] = [value for name in self._fields for value in parts[name]]
        return self._vector


def check_sources(manifest: Manifest) -> None:
    """Refuse a policy that observes what has no source here.

    Raises:
        PolicyError: names it, and what has one.
    """
    missing = [field.name for field in manifest.observation if field.name not in SOURCES]
    if missing:
        raise PolicyError(
            f"policy {manifest.name!r} observes {', '.join(missing)}, for which robots have no source yet: "
            f"choose one that observes only {', '.join(SOURCES)}"
        )


def ray_directions(body: Body) -> Floats:
    """Unit vectors (R, 2) of the sensor's rays, evenly spread."""
    angle = body.lidar_start_rad + np.arange(body.lidar_rays) * (2.0 * math.pi / max(body.lidar_rays, 1))
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def disc_ranges(
    origin: Vector2, discs: Sequence[Vector2], rays: Sequence[Vector2], body: Body
) -> list[float]:
    """Readings of one sensor, in m: see the module's text.

    Args:
        origin: the robot's centre.
        discs: the teammates' centres; all have the body's radius.
        rays: unit vectors.
        body: radius and sensor range.
    """
    ranges = [body.lidar_range_m] * len(rays)
    square = body.radius_m * body.radius_m
    visible = body.lidar_range_m + body.radius_m
    for disc_x, disc_y in discs:
        x, y = disc_x - origin[0], disc_y - origin[1]
        if x * x + y * y >= visible * visible:
            continue
        for ray, (ray_x, ray_y) in enumerate(rays):
            ahead, aside = x * ray_x + y * ray_y, x * ray_y - y * ray_x
            if ahead > 0.0 and aside * aside < square:
                ranges[ray] = min(ranges[ray], ahead - math.sqrt(square - aside * aside))
    return ranges
