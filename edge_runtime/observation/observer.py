"""The policy's input, composed in the order of the manifest's fields: SI units, the team's frame.

``goal_offset`` is position minus goal. ``ranges`` are the sensor's readings, ``proximity`` its range minus
its readings, so that free space is zero. Without a real sensor the readings are computed from the
teammates' discs, see `edge_runtime.motion.range_sensor`.
"""

from collections.abc import Sequence

import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.errors import PolicyError
from edge_runtime.messages import TeamState, Vector2
from edge_runtime.policy.manifest import Manifest

SOURCES = ("position", "velocity", "goal_offset", "proximity", "ranges")
"""The fields that can be composed here; a policy with others runs only where its simulation observes."""


class Observer:
    """Composes one robot's observations; the returned array is reused by the next call.

    Args:
        manifest: names the fields and the robot's body; already checked.
        goal_m: where the robot is to go.
        scale_m: one of the policy's metres, in the robot's.

    Raises:
        PolicyError: if the policy observes something that has no source here.
    """

    def __init__(self, manifest: Manifest, goal_m: Vector2, scale_m: float = 1.0) -> None:
        check_sources(manifest)
        self.goal_m = goal_m
        self._sensor = manifest.body.sensor()
        self._fields = tuple(field.name for field in manifest.observation)
        self._vector = np.zeros((1, manifest.observation_dim), np.float32)
        self._per_unit = _per_unit(manifest, scale_m) if scale_m != 1.0 else None

    def observe(self, team: TeamState) -> Array:
        """Compose the observation (1, O) of what the robot knows of itself and its teammates.

        Raises:
            PolicyError: if the number of readings is not the number of rays.
        """
        position, velocity = team.own.position_m, team.own.velocity_m_s
        ranges_m = self._sensor.read(team)
        reach = self._sensor.range_m
        parts: dict[str, Sequence[float]] = {
            "position": position,
            "velocity": velocity,
            "goal_offset": (position[0] - self.goal_m[0], position[1] - self.goal_m[1]),
            "proximity": [reach - reading for reading in ranges_m],
            "ranges": ranges_m,
        }
        self._vector[0] = [value for name in self._fields for value in parts[name]]
        if self._per_unit is not None:
            self._vector *= self._per_unit
        return self._vector


def _per_unit(manifest: Manifest, scale_m: float) -> Array:
    """The policy's units in one of the robot's, (O,): lengths and speeds scale, angles and numbers do not."""
    shares = [
        1.0 / scale_m if field.unit in ("m", "m/s", "m/s^2") else 1.0
        for field in manifest.observation
        for _ in range(field.size)
    ]
    return np.array(shares, np.float32)


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
