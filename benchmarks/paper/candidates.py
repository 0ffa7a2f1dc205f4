"""Every method with the eight settings it may be tuned over, the same number for each; Fig. 6's scales."""

from itertools import product

import msgspec

from benchmarks.paper.baselines import DescentSettings, ShieldSettings
from benchmarks.paper.contestants import (
    Contestant,
    cfpg,
    descent,
    ours,
    preference_conditioned,
    shielded,
    unguided_flow,
    unguided_gaussian,
)
from benchmarks.paper.tasks import Task
from edge_runtime.guidance.settings import GuidanceSettings, Mode

SCALES = (0.3, 1.0, 3.0, 10.0, 20.0, 30.0, 60.0, 100.0)
ROUNDS = (1, 2, 3, 5, 10, 20, 50, 100)
PREFERENCES = (
    (0.34, 0.33, 0.33),
    (0.5, 0.25, 0.25),
    (0.7, 0.15, 0.15),
    (0.85, 0.1, 0.05),
    (0.2, 0.4, 0.4),
    (0.5, 0.4, 0.1),
    (0.5, 0.1, 0.4),
    (0.6, 0.3, 0.1),
)
PROJECTIONS: dict[str, Mode] = {"CFPG (eqs. 14, 15)": "hierarchical", "CFPG (No HGP)": "none"}
"""The paper's method taken literally, and its ablation."""
METHODS = ("CFPG", *PROJECTIONS, "MAPPO+PGD", "MAPPO+SHLD", "PC-MAPPO")
"""``CFPG`` is the runtime's default mode, with objectives that keep robots out of each other's way."""

UNGUIDED = {"unguided flow": unguided_flow, "unguided MAPPO": unguided_gaussian}
"""The policies alone, for their nominal metrics."""


def candidates(task: Task, method: str) -> list[Contestant]:
    """One method on one task with each of its eight settings."""
    if method == "CFPG":
        grid = product((0.5, 2.0), (0.5, 1.0), (None, 1))
        return [ours(task, GuidanceSettings(scale=0.3, reach=r, start_noise=n), a) for r, n, a in grid]
    if method in PROJECTIONS:
        settings = [GuidanceSettings(mode=PROJECTIONS[method], scale=scale) for scale in SCALES]
        return [cfpg(task, method, setting) for setting in settings]
    if method == "MAPPO+PGD":
        radii = product((0.25, 0.5, 1.0, 2.0), (0.1, 0.5))
        return [descent(task, DescentSettings(radius=radius, rate=rate)) for radius, rate in radii]
    if method == "MAPPO+SHLD":
        return [shielded(task, ShieldSettings(rounds=rounds)) for rounds in ROUNDS]
    return [preference_conditioned(preference) for preference in PREFERENCES]


def scaled(task: Task, who: Contestant) -> list[Contestant]:
    """A guided contestant at every scale of Fig. 6.

    Raises:
        ValueError: if it is no guided flow.
    """
    if who.guidance is None:
        raise ValueError(f"{who.method} has no guidance scale")
    settings = [msgspec.structs.replace(who.guidance, scale=scale) for scale in SCALES]
    if who.method in PROJECTIONS:
        return [cfpg(task, who.method, setting) for setting in settings]
    return [ours(task, setting, who.look_ahead) for setting in settings]
