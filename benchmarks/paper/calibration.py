"""``python -m benchmarks calibration``: what the paper leaves open, chosen on the baselines alone.

Every candidate definition of a task is played by MAPPO+PGD and MAPPO+SHLD; the one whose figures come
nearest to the paper's own rows of the two, in units of `SCALES`, is frozen in
``export/scenarios/definitions.py``.

The paper does not say how far its projected gradient descent may move an action, so each definition is
weighed with the radius that suits it best. Only definitions are weighed that leave room to satisfy them,
whoever drives, which geometry and dynamics decide beforehand:

- Navigation: the longest straight way, across the arena, takes at most two thirds of the time limit at the
  speed limit; a margin that starts may already break is allowed for a tenth of the time at least.
- Balance: full thrust lifts the payload to the highest goal within the time limit.
- Sampling: MAPPO left alone gathers enough samples in nineteen of twenty episodes (0.4 a step; 0.6 a step
  it gathers in four of five).

Where tolerances bring a definition equally near, to a twentieth of a unit, the widest is taken.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import product
from pathlib import Path

import msgspec
import numpy as np
import torch
from msgspec import structs

from benchmarks.common.flags import add_policies, make_parser
from benchmarks.common.result_file import write_result
from benchmarks.common.result_page import table
from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import decider
from benchmarks.paper.policies import find_policy
from benchmarks.paper.settings import Descent, Shield
from benchmarks.paper.tasks import Task, make_task
from edge_runtime.policy.bundle import Bundle, load_bundle
from export.episodes.judges import Flags, Judge, Outcome
from export.episodes.neighbourhood import Setting
from export.scenarios.definitions import BALANCE, NAVIGATION, SAMPLING, Definition
from export.scenarios.navigation import ARENA_HALF_WIDTH_M, SPAWN_DISTANCE_M
from export.scenarios.scenario import Scenario, Transition

SETTING = Setting(episodes=100, episodes_seed=800)
RADII = (0.25, 0.5, 1.0, 2.0)
"""How far projected gradient descent may move an action."""
LONGEST_WAY_M = 2 * math.sqrt(2) * ARENA_HALF_WIDTH_M
DT_S = 0.1
SAMPLES_PER_STEP = 0.4
RESULTS = Path(__file__).parents[1] / "results"
PAPER = {
    "navigation": ((89.70, 0.03, 33.54, 59.64), (47.90, 0.00, 1.30, 47.32)),
    "balance": ((0.8219, 67.30, 0.2658, 1.30), (1.2193, 47.40, 0.1249, 3.60)),
    "sampling": ((124.37, 33.13, 0.1462, 50.80), (90.42, 14.20, 0.0908, 60.20)),
}
"""Tables II and III: three metrics and multi-objective success, of MAPPO+PGD and of MAPPO+SHLD."""
SCALES = {
    "navigation": (25.0, 25.0, 25.0, 25.0),
    "balance": (0.5, 25.0, 0.1, 25.0),
    "sampling": (30.0, 25.0, 0.05, 25.0),
}
"""Differences that count as one."""


class Candidate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A definition's figures, to be held against the paper's."""

    label: str
    descent: tuple[float, ...]
    shield: tuple[float, ...]
    distance: float


class Panel:
    """Several judges of the same episodes, which last until the last of them has seen enough.

    Its outcome has a column for each judge.
    """

    def __init__(self, judges: Sequence[Judge]) -> None:
        self._judges = judges

    @property
    def running(self) -> Flags:
        """(E,): episodes that are not over for some judge."""
        return np.any([judge.running for judge in self._judges], axis=0)

    def add(self, world: Scenario, transition: Transition) -> None:
        """Show a control step to all."""
        for judge in self._judges:
            judge.add(world, transition)

    def outcome(self) -> Outcome:
        """All outcomes side by side, (E, J)."""
        outcomes = [judge.outcome() for judge in self._judges]
        names = [field.name for field in fields(Outcome)]
        return Outcome(*(np.stack([getattr(one, name) for one in outcomes], 1) for name in names))


Group = list[tuple[str, Definition]]
"""Definitions that ask the same of the robots and judge it differently, by their labels."""


def navigation_groups() -> Iterator[Group]:
    """Speed limits with their time limits, and margins, each with several tolerances."""
    for limit, margin in product((0.2, 0.3), (0.25, 0.3, 0.35, 0.4)):
        steps = int(10 * math.ceil(0.15 * LONGEST_WAY_M / (limit * DT_S)))
        slow = structs.replace(NAVIGATION.speed_limit, limit_m_s=limit)
        apart = structs.replace(NAVIGATION.safety_margin, distance_m=margin)
        asked = replace(NAVIGATION, speed_limit=slow, safety_margin=apart, steps=steps)
        label = f"limit {limit} m/s, margin {margin} m, {steps} steps"
        yield [
            (f"{label}, tolerance {share:.0%}", replace(asked, tolerance=share))
            for share in (0.05, 0.1, 0.25, 0.5)
            if margin <= SPAWN_DISTANCE_M or share >= 0.1
        ]


def balance_groups() -> Iterator[Group]:
    """Spacings, pulls and time limits, each with several tolerances."""
    for spacing, pull, steps in product((0.12, 0.15), (0.4, 2.0), (300, 400)):
        order = structs.replace(BALANCE.spatial_order, pull=pull)
        spaced = structs.replace(BALANCE.spacing, distance_m=spacing)
        asked = replace(BALANCE, spatial_order=order, spacing=spaced, steps=steps)
        label = f"spacing {spacing} m, pull {pull:g}, {steps} steps"
        yield [
            (f"{label}, tolerance {off} m", replace(asked, spacing_tolerance_m=off))
            for off in (0.01, 0.02, 0.03, 0.05)
        ]


def sampling_groups() -> Iterator[Group]:
    """Fences, cluster radii and lengths of episodes, each with several tolerances."""
    for fence, buffer, radius, steps in product((0.2, 0.3), (0.02, 0.05), (0.2, 0.3), (100, 150)):
        enough = SAMPLES_PER_STEP * steps
        outside = structs.replace(SAMPLING.geofence, radius_m=fence, buffer_m=buffer)
        together = structs.replace(SAMPLING.clustering, radius_m=radius)
        asked = replace(SAMPLING, geofence=outside, clustering=together, steps=steps, enough_samples=enough)
        label = f"fence {fence} + {buffer} m, cluster {radius} m, {steps} steps, {enough:g} samples"
        yield [
            (
                f"{label}, tolerance {share:.0%} and {off} m",
                replace(asked, tolerance=share, cluster_tolerance_m=off),
            )
            for share, off in product((0.05, 0.25), (0.1, 0.15))
        ]


GROUPS = {"navigation": navigation_groups, "balance": balance_groups, "sampling": sampling_groups}


def weigh(name: str, group: Group, bundle: Bundle) -> list[Candidate]:
    """Play what a group asks by both baselines, once for all its definitions."""
    tasks = [make_task(name, definition) for _, definition in group]
    task = replace(tasks[0], judge=lambda count: Panel([each.judge(count) for each in tasks]))
    *descended, shielding = (
        _figures(task, run_episodes(task, decider(task, settings, bundle), SETTING))
        for settings in (*(Descent(radius=radius) for radius in RADII), Shield())
    )
    weighed = []
    for j, (label, _) in enumerate(group):
        tried = [
            Candidate(f"{label}, radius {radius:g}", figures[j], shielding[j], off)
            for radius, figures in zip(RADII, descended, strict=True)
            for off in [distance(name, (figures[j], shielding[j]))]
        ]
        weighed.append(min(tried, key=lambda candidate: candidate.distance))
    return weighed


def distance(task: str, figures: Sequence[Sequence[float]]) -> float:
    """Root mean square difference from the paper's rows, in units of `SCALES`."""
    off = (np.array(figures) - np.array(PAPER[task])) / np.array(SCALES[task])
    return float(np.sqrt(np.square(off).mean()))


def main(arguments: Sequence[str]) -> int:
    """Weigh all candidates of a task; writes them with the nearest first."""
    parser = make_parser("calibration", __doc__)
    parser.add_argument("task", choices=list(GROUPS))
    add_policies(parser)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    bundle = load_bundle(find_policy(options.policies, options.task, "mappo", seed=0))
    weighed: list[Candidate] = []
    for group in GROUPS[options.task]():
        weighed += weigh(options.task, group, bundle)
        print(f"{weighed[-1].label}: {weighed[-1].distance:.2f}", file=sys.stderr, flush=True)
    weighed.sort(key=lambda candidate: candidate.distance)
    write_result(RESULTS / f"calibration_{options.task}.json", weighed)
    lines = [[c.label, _cells(c.descent), _cells(c.shield), f"{c.distance:.2f}"] for c in weighed[:10]]
    print(table(["definition", "MAPPO+PGD", "MAPPO+SHLD", "distance"], lines))
    return 0


def _figures(task: Task, outcome: Outcome) -> list[tuple[float, ...]]:
    """Each judge's four figures, as in the paper's tables."""
    factors = np.array([*(metric.factor for metric in task.metrics), 100.0])
    columns = (outcome.nominal, outcome.first, outcome.second, outcome.satisfied)
    shown = factors[:, None] * np.array([column.mean(0) for column in columns])
    return [tuple(figures) for figures in shown.T.tolist()]


def _cells(figures: Sequence[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in figures)
