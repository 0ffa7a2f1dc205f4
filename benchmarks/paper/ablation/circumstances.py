"""The ablation's variants of what robots foresee and hear, and of the robots themselves."""

from functools import partial

import msgspec

from benchmarks.paper.ablation.mixed_team import guided_by_own_mass
from benchmarks.paper.ablation.variants import Reference, Variant
from benchmarks.paper.ablation.views import uninformed
from benchmarks.paper.methods import guided

LOSSES = (0.2, 0.5, 0.8)
MASSES_KG = (1.0, 1.0, 2.0, 2.0)
"""Navigation's robots weigh 1 kg, and its policies were trained so."""


def look_aheads(ref: Reference) -> list[Variant]:
    """How far ahead objectives look, where the reference looks otherwise."""
    own = (*ref.task.objectives, *ref.task.deconfliction)
    near = tuple(msgspec.structs.replace(objective, look_ahead=1) for objective in own)
    far = tuple(msgspec.structs.replace(o, look_ahead=2 * o.look_ahead) for o in own)
    choices = [
        ("look-ahead 1", "What seeing further than one step is good for.", near),
        ("look-ahead own", "As many steps as the objectives themselves propose.", own),
        ("look-ahead doubled", "Twice as many steps as the objectives themselves propose.", far),
    ]
    return [
        ref.variant(name, reason, partial(guided, ref.settings, objectives))
        for name, reason, objectives in choices
        if objectives != ref.objectives
    ]


def intentions(ref: Reference) -> list[Variant]:
    """Whether robots know what their teammates are about to do."""
    make = partial(uninformed, ref.settings, ref.objectives)
    return [ref.variant("intentions unknown", "Teammates' intended actions taken as zero.", make)]


def network(ref: Reference) -> list[Variant]:
    """Fewer neighbours than teammates, and lost messages."""
    make = partial(guided, ref.settings, ref.objectives)
    few = [
        ref.variant(
            f"neighbours {count}",
            f"Only the {count} nearest of {ref.robots - 1} heard.",
            make,
            neighbours=count,
        )
        for count in (1, 2)
        if count < ref.robots - 1
    ]
    lossy = [
        ref.variant(
            f"loss {loss:.0%}", "Messages lost, each teammate where it was last heard of.", make, loss=loss
        )
        for loss in LOSSES
    ]
    return few + lossy


def masses(ref: Reference) -> list[Variant]:
    """Two robots of twice the mass, with the same policy."""
    if ref.task.name != "navigation":
        return []
    known = partial(guided_by_own_mass, ref.settings, ref.objectives, MASSES_KG)
    return [
        ref.variant(
            "two heavy, known",
            "Two robots of twice the mass, each guided by its own dynamics.",
            known,
            masses_kg=MASSES_KG,
        ),
        ref.variant(
            "two heavy, unknown",
            "The same team, guided as if all weighed the same.",
            partial(guided, ref.settings, ref.objectives),
            masses_kg=MASSES_KG,
        ),
    ]
