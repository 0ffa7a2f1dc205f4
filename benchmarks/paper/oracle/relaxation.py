"""Which starts of Sampling nobody can gather in time: a relaxation that leaves out whatever else is asked.

Time by time, each robot may be anywhere that full force brings it to along either axis. The radius of the
cluster is (1/N) sum_i |p_i - c|, so at least (1/N) sum_i (u_i - mean u) . p_i for any vectors u_i no longer
than one; over boxes of half-width D around the starts this is least at

    (1/N) (sum_i (u_i - mean u) . p_i - D sum_i |u_i - mean u|_1).

Whatever the u_i, this is a lower bound; descent of the radius within the boxes finds good ones. A start is
ruled out if the bounds' excess over the wanted radius alone uses up what the definition tolerates.
"""

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.motion.prediction import Preview
from export.episodes.judges import Flags
from export.scenarios.definitions import SamplingDefinition

ROUNDS = 300
"""Of descent."""


def never_gathered(position: Floats, definition: SamplingDefinition, step: Preview) -> Flags:
    """Starts at rest (E, N, 2) whose radius must deviate too far; ``step`` is the motion's, of one step."""
    square, moved, speed = np.zeros(len(position)), 0.0, 0.0
    for _ in range(definition.steps):
        moved, speed = (
            moved + step.position_decay * speed + step.position_gain,
            step.velocity_decay * speed + step.velocity_gain,
        )
        excess = np.maximum(least_radius(position, moved) - definition.clustering.radius_m, 0.0)
        square += np.square(excess)
        if not excess.any():
            break
    return square > definition.steps * definition.cluster_tolerance_m**2


def least_radius(position: Floats, moved: float) -> Floats:
    """Bound the radius (E,) from below: robots at (E, N, 2) may each move ``moved`` along either axis."""
    robots, place = position.shape[1], position.copy()
    bound, pull = np.zeros(len(position)), np.zeros_like(position)
    for round_ in range(1, ROUNDS + 1):
        away = place - place.mean(1, keepdims=True)
        away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-12)
        pull += (away - pull) * 2.0 / (round_ + 1.0)
        for vector in (away, pull):
            relative = vector - vector.mean(1, keepdims=True)
            least = (relative * position).sum((1, 2)) - moved * np.abs(relative).sum((1, 2))
            bound = np.maximum(bound, least / robots)
        slope = away - away.mean(1, keepdims=True)
        place = np.clip(place - moved / np.sqrt(round_) * slope, position - moved, position + moved)
    return bound
