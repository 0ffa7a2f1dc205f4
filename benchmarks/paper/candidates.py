"""Every method with the eight settings it may be tuned over: the same number for each."""

from itertools import product

from benchmarks.paper.baselines import DescentSettings, ShieldSettings
from benchmarks.paper.contestants import Contestant, cfpg, descent, preference_conditioned, shielded
from benchmarks.paper.tasks import Task
from edge_runtime.guide import GuidanceSettings, Mode

SCALES = (1.0, 3.0, 5.0, 10.0, 20.0, 30.0, 60.0, 100.0)
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
MODES: dict[str, Mode] = {"CFPG": "terminal", "CFPG (eqs. 14, 15)": "hierarchical", "CFPG (No HGP)": "none"}
"""``CFPG`` is the runtime's default mode; the paper's projections taken literally stand beside it."""
METHODS = (*MODES, "MAPPO+PGD", "MAPPO+SHLD", "PC-MAPPO")


def candidates(task: Task, method: str) -> list[Contestant]:
    """One method on one task with each of its eight settings."""
    if method in MODES:
        settings = [GuidanceSettings(mode=MODES[method], scale=scale) for scale in SCALES]
        return [cfpg(task, method, setting) for setting in settings]
    if method == "MAPPO+PGD":
        grid = product((0.25, 0.5, 1.0, 2.0), (0.1, 0.5))
        return [descent(task, DescentSettings(radius=radius, rate=rate)) for radius, rate in grid]
    if method == "MAPPO+SHLD":
        return [shielded(task, ShieldSettings(rounds=rounds)) for rounds in ROUNDS]
    return [preference_conditioned(preference) for preference in PREFERENCES]
