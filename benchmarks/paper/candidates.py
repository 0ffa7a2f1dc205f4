"""Every method with the eight settings it may be tuned over, the same number for each; Fig. 6's scales."""

from itertools import product

from msgspec.structs import replace

from benchmarks.paper.settings import UNGUIDED, Descent, Guided, Mean, Preferring, Settings, Shield
from benchmarks.paper.tasks import TASKS
from edge_runtime.guidance.settings import GuidanceSettings, Mode

SCALES = (0.3, 1.0, 3.0, 10.0, 20.0, 30.0, 60.0, 100.0)
RADII = (0.25, 0.5, 1.0, 2.0)
ROUNDS = (1, 2, 3, 5, 10, 20, 50, 100)
CHOICES: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "navigation": ({"ease_m": 0.0}, {"ease_m": 0.1}),
    "balance": ({"reach": 0.5}, {"reach": 0.3, "goal_reach": 2.0}),
    "sampling": ({"reach": 2.0}, {"reach": 4.0}),
}
"""What the default mode chooses between, by task."""
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
ALONE: dict[str, Settings] = {"unguided flow": UNGUIDED, "unguided MAPPO": Mean()}
"""The policies alone, for their nominal metrics."""


def candidates(method: str, task: str) -> list[Settings]:
    """The eight settings of a method on a task; who corrects actions has the belief, if there is one."""
    belief = bool(TASKS[task].belief)
    if method == "CFPG":
        return [
            Guided(
                guidance=GuidanceSettings(scale=0.3, start_noise=noise, **choice),
                deconfliction=True,
                belief=belief,
                look_ahead=ahead,
            )
            for choice, noise, ahead in product(CHOICES[task], (0.5, 1.0), (None, 1))
        ]
    if method in PROJECTIONS:
        return [Guided(guidance=GuidanceSettings(mode=PROJECTIONS[method], scale=s)) for s in SCALES]
    if method == "MAPPO+PGD":
        grid = product(RADII, (0.1, 0.5))
        return [Descent(radius=radius, rate=rate, belief=belief) for radius, rate in grid]
    if method == "MAPPO+SHLD":
        return [Shield(rounds=rounds, belief=belief) for rounds in ROUNDS]
    return [Preferring(preference=preference) for preference in PREFERENCES]


def scaled(settings: Settings) -> list[Guided]:
    """A guided flow at every scale of Fig. 6.

    Raises:
        ValueError: if it is no guided flow.
    """
    if not isinstance(settings, Guided):
        raise ValueError(f"{settings} has no guidance scale")
    return [replace(settings, guidance=replace(settings.guidance, scale=scale)) for scale in SCALES]
