"""What the ablation changes about the tuned default, a variant at a time, and why."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import msgspec

from benchmarks.paper.ablation.joint import combine_teams
from benchmarks.paper.ablation.priorities import all_preferred, all_required
from benchmarks.paper.ablation.samples import best_of
from benchmarks.paper.contestants import Contestant
from benchmarks.paper.methods import guided, post_processed
from benchmarks.paper.tasks import Task
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import Objective
from export.evaluation.projection import hierarchical_batch
from export.scenarios import scenario_facts

SAMPLES = 4
VANISHING = 1e-9
"""An eta that leaves objectives active and the flow as it is."""
UNLIMITED = 1e3
"""A reach that no action can use up."""


@dataclass(frozen=True)
class Variant:
    """One row of the ablation."""

    name: str
    """Begins its rows' mode."""
    reason: str
    """What it is to show, in a sentence."""
    who: Contestant
    neighbours: int | None = None
    """K, the nearest at every step; None for all."""
    loss: float = 0.0
    """Share of the messages lost."""
    masses_kg: tuple[float, ...] | None = None
    """Of Navigation's robots; None for the task's own."""


@dataclass(frozen=True)
class Reference:
    """The tuned default on a task, which every variant changes in one point."""

    task: Task
    who: Contestant
    settings: GuidanceSettings
    objectives: tuple[Objective, ...]

    @property
    def judged(self) -> tuple[Objective, ...]:
        """The task's objectives, without what only keeps robots out of each other's way."""
        return self.objectives[: len(self.task.objectives)]

    @property
    def robots(self) -> int:
        """N."""
        return scenario_facts(self.task.name).robots

    def variant(self, name: str, reason: str, make: Callable[..., object], **changes: object) -> Variant:
        """The reference with another ``make``, and in other circumstances."""
        who = replace(self.who, mode=named(name, self.who), make=make)
        return Variant(name, reason, who, **changes)

    def shaped(self, name: str, reason: str, shape: Callable[..., object]) -> Variant:
        """The reference with a guide that is reshaped."""
        return self.variant(name, reason, partial(guided, self.settings, self.objectives, shape=shape))

    def set(self, name: str, reason: str, **settings: object) -> Variant:
        """The reference with other settings."""
        changed = msgspec.structs.replace(self.settings, **settings)
        return self.variant(name, reason, partial(guided, changed, self.objectives))


def named(name: str, who: Contestant) -> str:
    """A variant's mode, which tells apart what was tuned otherwise."""
    return f"{name}, of {who.mode}"


def reference(task: Task, who: Contestant) -> Reference:
    """Take a tuned default apart.

    Raises:
        ValueError: if it is no guided flow.
    """
    if who.guidance is None:
        raise ValueError(f"{who.method} is no guided flow")
    _settings, objectives = who.make.args  # of `contestants.cfpg`: tuning may have changed how far they look
    return Reference(task, who, who.guidance, objectives)


def itself(ref: Reference) -> list[Variant]:
    """The reference."""
    return [ref.set("reference", "The tuned default, which every other row changes in one point.")]


def projections(ref: Reference) -> list[Variant]:
    """How conflicts are resolved, at the tuned eta, and where along tau guidance acts."""
    return [
        ref.set("projection none", "The sum of all gradients: what resolving conflicts adds.", mode="none"),
        ref.set(
            "projection hierarchical",
            "Eqs. 14 and 15 taken literally: guidance along the flow only, and no braking.",
            mode="hierarchical",
        ),
        ref.set(
            "projection cone", "The exact common descent instead of eq. 14, without eq. 15.", mode="cone"
        ),
        ref.set(
            "tau = 1 only",
            "The flow left alone and its action corrected: what guidance along the flow adds.",
            scale=VANISHING,
        ),
        ref.variant(
            "joint hierarchical",
            "Eqs. 14 and 15 on the team's joint action, as the paper writes them; compare with hierarchical.",
            partial(
                guided,
                msgspec.structs.replace(ref.settings, mode="hierarchical"),
                ref.objectives,
                combine=partial(combine_teams, hierarchical_batch, ref.robots),
            ),
        ),
    ]


def deconfliction(ref: Reference, descent: Contestant) -> list[Variant]:
    """Objectives that nobody is judged by: without them, and what they alone bring a baseline."""
    if not ref.task.deconfliction:
        return []
    adapt = descent.make.args[0]  # of `contestants.descent`: radius and rate as tuned
    helped = partial(post_processed, adapt, (*ref.task.objectives, *ref.task.deconfliction))
    return [
        ref.variant(
            "deconfliction off",
            "Objectives as the paper has them, none that keeps robots out of each other's way.",
            partial(guided, ref.settings, ref.judged),
        ),
        Variant(
            "MAPPO+PGD",
            "The baseline as tuned, to compare the next row with.",
            replace(descent, mode=named("MAPPO+PGD", descent)),
        ),
        Variant(
            "MAPPO+PGD, deconfliction on",
            "What keeping out of each other's way brings without a guided flow.",
            replace(descent, mode=named("MAPPO+PGD, deconfliction on", descent), make=helped),
        ),
    ]


def priorities(ref: Reference) -> list[Variant]:
    """Whether some objectives may wait for others at tau = 1."""
    kinds = {objective.preference for objective in ref.objectives}
    found = []
    if True in kinds:
        found += [
            ref.set("reach unlimited", "Wishes may move an action however far.", reach=UNLIMITED),
            ref.shaped("all required", "Wishes count as requirements: no priorities.", all_required),
        ]
    if False in kinds:
        found += [
            ref.shaped("all preferred", "Requirements count as wishes: they yield too.", all_preferred),
        ]
    return found


def samplings(ref: Reference) -> list[Variant]:
    """Several samples a robot, of which the best is taken."""
    make = partial(best_of, ref.settings, ref.objectives, SAMPLES)
    return [
        ref.variant(
            f"best of {SAMPLES}, each robot",
            "Cost and likelihood choose among several samples, each robot for itself.",
            partial(make, None),
        ),
        ref.variant(
            f"best of {SAMPLES}, team",
            "The team chooses one index for all, knowing what everybody would do.",
            partial(make, ref.robots),
        ),
    ]
