"""Who takes part: the paper's five methods and our default, each with the settings that tuning chose."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from benchmarks.paper.baselines import DescentSettings, ShieldSettings, descend, shield
from benchmarks.paper.episodes import MakeDecide
from benchmarks.paper.methods import guided, post_processed, preferring
from benchmarks.paper.tasks import Task
from edge_runtime.bundle import Bundle
from edge_runtime.guide import GuidanceSettings


@dataclass(frozen=True)
class Contestant:
    """One method on one task."""

    method: str
    """As in the paper."""
    mode: str
    algorithm: str
    """What trained its policy."""
    make: Callable[[Bundle], MakeDecide]


def cfpg(task: Task, method: str, settings: GuidanceSettings) -> Contestant:
    """A flow policy guided by the task's objectives."""
    mode = f"{settings.mode}, eta {settings.scale:g}"
    return Contestant(method, mode, "mafpo-chain", partial(guided, settings, task.objectives))


def descent(task: Task, settings: DescentSettings) -> Contestant:
    """MAPPO with projected gradient descent."""
    mode = f"radius {settings.radius:g}, rate {settings.rate:g}, {settings.steps} steps"
    return Contestant(
        "MAPPO+PGD", mode, "mappo", partial(post_processed, partial(descend, settings), task.objectives)
    )


def shielded(task: Task, settings: ShieldSettings) -> Contestant:
    """MAPPO with a shield."""
    mode = f"{settings.rounds} rounds"
    return Contestant(
        "MAPPO+SHLD", mode, "mappo", partial(post_processed, partial(shield, settings), task.objectives)
    )


def preference_conditioned(preference: tuple[float, float, float]) -> Contestant:
    """PC-MAPPO."""
    mode = "preference " + ", ".join(f"{weight:g}" for weight in preference)
    return Contestant("PC-MAPPO", mode, "pc-mappo", partial(preferring, preference))
