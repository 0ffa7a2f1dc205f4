"""Who takes part: the paper's five methods and our default, each with the settings that tuning chose."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import msgspec

from benchmarks.paper.baselines import DescentSettings, ShieldSettings, descend, shield
from benchmarks.paper.episodes import MakeDecide
from benchmarks.paper.methods import guided, post_processed, preferring
from benchmarks.paper.tasks import Task
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import Objective


@dataclass(frozen=True)
class Contestant:
    """One method on one task."""

    method: str
    """As in the paper."""
    mode: str
    algorithm: str
    """What trained its policy."""
    make: Callable[..., MakeDecide]
    """From a bundle; of a guided flow also from a number of Euler steps."""
    guidance: GuidanceSettings | None = None
    """Of a guided flow."""
    look_ahead: int | None = None
    """Of all its objectives, in control steps; None for their own."""


FLOWS = {"navigation": "mafpo-chain", "balance": "mafpo-warm", "sampling": "mafpo-chain"}
"""The guided flow policies, by task: on Balance those that follow guidance better, else the default."""


def cfpg(
    task: Task, method: str, settings: GuidanceSettings, objectives: tuple[Objective, ...] | None = None
) -> Contestant:
    """A flow policy guided by the task's objectives, or by others."""
    words = [settings.mode, f"eta {settings.scale:g}", f"noise {settings.start_noise:g}"]
    if settings.mode == "terminal":
        words.append(f"reach {settings.reach:g}")
    make = partial(guided, settings, task.objectives if objectives is None else objectives)
    return Contestant(method, ", ".join(words), FLOWS[task.name], make, settings)


def ours(task: Task, settings: GuidanceSettings, look_ahead: int | None = None) -> Contestant:
    """The default mode, with objectives that keep robots out of each other's way.

    All objectives look ``look_ahead`` steps ahead; as far as they do by themselves where None.
    """
    objectives = (*task.objectives, *task.deconfliction)
    if look_ahead is None:
        return cfpg(task, "CFPG", settings, objectives)
    nearer = tuple(msgspec.structs.replace(objective, look_ahead=look_ahead) for objective in objectives)
    who = cfpg(task, "CFPG", settings, nearer)
    return replace(who, mode=f"{who.mode}, look-ahead {look_ahead}", look_ahead=look_ahead)


def unguided_flow(task: Task) -> Contestant:
    """The flow policy alone, started from the paper's prior."""
    return cfpg(task, "unguided flow", GuidanceSettings(mode="none", scale=0.0), ())


def unguided_gaussian(_task: Task) -> Contestant:
    """MAPPO's mean alone."""
    make = partial(guided, GuidanceSettings(mode="none", scale=0.0, start_noise=0.0), ())
    return Contestant("unguided MAPPO", "mean", "mappo", make)


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
