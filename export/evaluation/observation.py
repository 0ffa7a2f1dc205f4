"""`edge_runtime.observation.observer` for B robots."""

import numpy as np

from edge_runtime.common.arrays import Array, Floats
from edge_runtime.observation.observer import check_sources, ray_directions
from edge_runtime.policy.manifest import Body, Manifest
from export.evaluation.outlook import TeamBatch


def observe_batch(manifest: Manifest, team: TeamBatch, goal_m: Floats) -> Array:
    """Compose the observations of B robots with goals (B, 2): (B, O).

    A non-finite state leaves its own row non-finite.

    Raises:
        PolicyError: if the policy observes something that has no source here.
    """
    check_sources(manifest)
    ranges = disc_ranges_batch(team, manifest.body)
    parts = {
        "position": team.position_m,
        "velocity": team.velocity_m_s,
        "goal_offset": team.position_m - goal_m,
        "proximity": manifest.body.lidar_range_m - ranges,
        "ranges": ranges,
    }
    return np.concatenate([parts[field.name] for field in manifest.observation], -1).astype(np.float32)


def disc_ranges_batch(team: TeamBatch, body: Body) -> Floats:
    """Readings (B, R) of B sensors, in m."""
    rays = ray_directions(body)
    offset = team.mate_position_m - team.position_m[:, None]
    ahead = offset @ rays.T
    aside = offset @ np.stack([rays[:, 1], -rays[:, 0]])
    chord = body.radius_m**2 - np.square(aside)
    passed = (ahead <= 0.0) | (chord <= 0.0)
    reading = np.where(passed, body.lidar_range_m, ahead - np.sqrt(np.maximum(chord, 0.0)))
    nearest: Floats = reading.min(1, initial=body.lidar_range_m)
    return nearest
