"""What the ablation changes about the tuned default, a variant at a time, and why."""

from collections.abc import Iterator
from itertools import product
from typing import Any

import msgspec
from msgspec.structs import replace

from benchmarks.paper.settings import Descent, Guided, Settings, Shield
from benchmarks.paper.tasks import Task
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import SafetyMargin

VANISHING = 1e-9
"""An eta that leaves objectives active and the flow as it is."""
UNLIMITED = 1e3
"""A reach that no action can use up."""
EASES_CM = (0, 5, 10, 15)
USUAL_REACH = GuidanceSettings().reach
VALUE_SCALES = (0.1, 0.3)
LOSSES = (0.2, 0.5, 0.8)


class Variant(msgspec.Struct, frozen=True):
    """One row of the ablation: what is asked, with a name and the sentence that says what it shows."""

    name: str
    reason: str
    method: str
    settings: Settings
    circumstances: dict[str, Any] = {}
    """Of `rows.Setting`, where they are not the usual ones."""


def variants(task: Task, tuned: Guided, descent: Descent, shield: Shield) -> Iterator[Variant]:
    """Every variant that means something on a task, the reference first.

    Args:
        task: the task.
        tuned: the default as tuned for it.
        descent: the baseline as tuned for it.
        shield: the other one as tuned for it.
    """
    yield Variant(
        "reference", "The tuned default, which every other row changes in one point.", "CFPG", tuned
    )
    yield from _guidance(tuned)
    once = replace(tuned.guidance, requirement_steps=1)
    reason = (
        f"Requirements corrected once; the reference takes up to {tuned.guidance.requirement_steps} steps."
    )
    yield _changed("1 step", reason, tuned, guidance=once)
    if task.deconfliction:
        reason = "Objectives as the paper has them, none that keeps robots out of each other's way."
        yield _changed("deconfliction off", reason, tuned, deconfliction=False)
    if any(isinstance(objective, SafetyMargin) for objective in task.objectives):
        yield from _ease(tuned)
    if task.belief:
        reason = "Robots do not know where most samples are left."
        yield _changed("belief off", reason, tuned, belief=False)
    if tuned.guidance.goal_reach is not None:
        yield from _waiting(tuned)
    yield from _values(tuned)
    yield from _priorities(task, tuned)
    yield from _look_aheads(task, tuned)
    yield from _network(task, tuned)
    yield from _baselines(task, tuned, descent, shield)


def _guidance(tuned: Guided) -> Iterator[Variant]:
    """How conflicts are resolved, at the tuned eta, and where along tau guidance acts."""
    unresolved, literal, cone, unguided = (
        replace(tuned.guidance, **changes)
        for changes in ({"mode": "none"}, {"mode": "hierarchical"}, {"mode": "cone"}, {"scale": VANISHING})
    )
    reason = "The sum of all gradients: what resolving conflicts adds."
    yield _changed("projection none", reason, tuned, guidance=unresolved)
    reason = "Eqs. 14 and 15 taken literally: guidance along the flow only, and no braking."
    yield _changed("projection hierarchical", reason, tuned, guidance=literal)
    reason = "The exact common descent instead of eq. 14, without eq. 15."
    yield _changed("projection cone", reason, tuned, guidance=cone)
    reason = "The flow left alone and its action corrected: what guidance along the flow adds."
    yield _changed("tau = 1 only", reason, tuned, guidance=unguided)
    reason = "Eqs. 14 and 15 on the team's joint action, as the paper writes them; compare with hierarchical."
    yield _changed("joint hierarchical", reason, tuned, guidance=literal, joint=True)


def _baselines(task: Task, tuned: Guided, descent: Descent, shield: Shield) -> Iterator[Variant]:
    """What the default's choices bring without a guided flow: baselines as tuned, and given each of them."""
    asked: dict[str, Descent | Shield] = {"MAPPO+PGD": descent, "MAPPO+SHLD": shield}
    for method, baseline in asked.items():
        yield Variant(method, "The baseline as tuned, to compare the next rows with.", method, baseline)
        if task.belief:
            reason = "The baseline that does not know where most samples are left."
            yield Variant(f"{method}, belief off", reason, method, replace(baseline, belief=False))
        if tuned.guidance.ease_m:
            reason = "What seeing teammates farther away brings without a guided flow."
            eased = replace(baseline, ease_m=tuned.guidance.ease_m)
            yield Variant(f"{method}, ease", reason, method, eased)
    if task.deconfliction:
        reason = "What keeping out of each other's way brings without a guided flow."
        parted = replace(descent, deconfliction=True)
        yield Variant("MAPPO+PGD, deconfliction on", reason, "MAPPO+PGD", parted)
    if tuned.guidance.goal_reach is not None:
        reason = "What formations that wait for the goal bring without a guided flow."
        waiting = replace(descent, goal_radius=tuned.guidance.goal_reach)
        yield Variant("MAPPO+PGD, formation at the goal", reason, "MAPPO+PGD", waiting)
        reason = "Both."
        both = replace(waiting, deconfliction=True)
        yield Variant("MAPPO+PGD, deconfliction, formation at the goal", reason, "MAPPO+PGD", both)


def _ease(tuned: Guided) -> Iterator[Variant]:
    """Teammates seen farther away than they are, the distance left to the margin."""
    for ease_m in (centimetres / 100.0 for centimetres in EASES_CM):
        if ease_m != tuned.guidance.ease_m:
            reason = "The policy sees teammates so much farther away: the distance is the margin's alone."
            eased = replace(tuned.guidance, ease_m=ease_m)
            yield _changed(f"ease {100 * ease_m:g} cm", reason, tuned, guidance=eased)


def _waiting(tuned: Guided) -> Iterator[Variant]:
    """Formations that do not wait for the goal."""
    near = replace(tuned.guidance, goal_reach=None)
    yield _changed("formation as asked underway", "No more at the goal.", tuned, guidance=near)
    usual = replace(near, reach=USUAL_REACH)
    reason = "No more at the goal, and more underway."
    yield _changed(f"reach {USUAL_REACH:g} everywhere", reason, tuned, guidance=usual)


def _values(tuned: Guided) -> Iterator[Variant]:
    """What actions are worth to the task counts beside what objectives cost."""
    for scale, first in product(VALUE_SCALES, (False, True)):
        reason = (
            "What actions are worth to the task is followed before preferences, within their reach."
            if first
            else "Preferences minimise J - kappa Q within their reach, Q what actions are worth to the task."
        )
        changes = {"value_scale": scale, "value_first": first}
        yield _changed(f"value {scale:g}{' first' if first else ''}", reason, tuned, **changes)


def _priorities(task: Task, tuned: Guided) -> Iterator[Variant]:
    """Whether some objectives may wait for others at tau = 1."""
    wishes = {objective.preference for objective in (*task.objectives, *task.deconfliction)}
    if True in wishes:
        unlimited = replace(tuned.guidance, reach=UNLIMITED, goal_reach=None)
        yield _changed("reach unlimited", "Wishes may move an action however far.", tuned, guidance=unlimited)
        reason = "Wishes count as requirements: no priorities."
        yield _changed("all required", reason, tuned, corrected_as="requirements")
    if False in wishes:
        reason = "Requirements count as wishes: they yield too."
        yield _changed("all preferred", reason, tuned, corrected_as="preferences")


def _look_aheads(task: Task, tuned: Guided) -> Iterator[Variant]:
    """How far ahead objectives look, where the reference looks otherwise."""
    own = {objective.look_ahead for objective in task.objectives}
    near, usual = "look-ahead 1", "look-ahead own"
    if tuned.look_ahead != 1 and own != {1}:
        yield _changed(near, "What seeing further than one step is good for.", tuned, look_ahead=1)
    if tuned.look_ahead is not None:
        reason = "As many steps as the objectives themselves propose."
        yield _changed(usual, reason, tuned, look_ahead=None)
    reason = "Twice as many steps as the objectives themselves propose."
    yield _changed("look-ahead doubled", reason, tuned, look_ahead=None, look_ahead_factor=2)


def _network(task: Task, tuned: Guided) -> Iterator[Variant]:
    """Fewer neighbours than teammates, lost messages, and messages that tell less."""
    reason = "Teammates' intended actions taken as zero."
    yield Variant("intentions unknown", reason, "CFPG", tuned, {"intentions": False})
    for count in range(1, min(3, task.robots - 1)):
        reason = f"Only the {count} nearest of {task.robots - 1} heard."
        yield Variant(f"neighbours {count}", reason, "CFPG", tuned, {"neighbours": count})
    for loss in LOSSES:
        reason = "Messages lost, each teammate where it was last heard of."
        yield Variant(f"loss {loss:.0%}", reason, "CFPG", tuned, {"loss": loss})


def _changed(name: str, reason: str, tuned: Guided, **changes: object) -> Variant:
    return Variant(name, reason, "CFPG", replace(tuned, **changes))
