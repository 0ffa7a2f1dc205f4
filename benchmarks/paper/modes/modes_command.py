"""``python -m benchmarks modes``: how many ways round each other a policy knows."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import torch

from benchmarks.common.flags import COUNT, add_policies, make_parser
from benchmarks.common.result_file import write_result
from benchmarks.common.result_page import table
from benchmarks.paper.evaluation import commit
from benchmarks.paper.methods import decider
from benchmarks.paper.modes.meetings import Meetings, meet
from benchmarks.paper.modes.picture import Panel, along, draw_meetings, most_divided
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.settings import UNGUIDED, Mean, Settings
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default
from edge_runtime.policy.bundle import load_bundle
from export.scenarios.navigation import FACTS

RESULTS = Path(__file__).parents[2] / "results" / "paper_modes.json"
SCENES = 8
"""Headings, evenly spread."""
SEEDS = (1, 2)
"""Of the policies; guidance was tuned on seed 0."""
RARE = 0.1
"""A scene has two ways if each side gets this share of its passes at least."""


class MeetingRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Shares in percent over the meetings of one seed's policy."""

    settings: Settings
    seed: int
    """Of the policy's training."""
    scenes: int
    episodes: int
    """Of all scenes together."""
    left: float
    """Both kept to their left."""
    right: float
    stand_off: float
    """Never passed."""
    two_ways: float
    """Scenes, in percent, in which either side is taken in a tenth of the passes or more."""
    collided: float
    seconds_to_goal: float | None
    """Median of those that arrived; None if none did."""
    policy: str
    """Digest of its manifest."""
    commit: str


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("modes", __doc__)
    parser.add_argument("--samples", type=COUNT, default=50, metavar="N", help="episodes of a scene (50)")
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS, help="of the policies (1 2)")
    add_policies(parser)
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="the rows")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    rows, panels = _measure(options)
    write_result(options.json, rows)
    draw_meetings(panels, options.json.parent / "paper" / "modes.png")
    print(modes_table(rows))
    return 0


def contestants() -> dict[str, Settings]:
    """A flow from samples and from its mean, the tuned default, and MAPPO's mean."""
    still = msgspec.structs.replace(UNGUIDED.guidance, start_noise=0.0)
    return {
        "flow": UNGUIDED,
        "flow from its mean": msgspec.structs.replace(UNGUIDED, guidance=still),
        "CFPG": tuned_default("navigation"),
        "MAPPO": Mean(),
    }


def summed_up(settings: Settings, seed: int, met: Meetings, policy: str) -> MeetingRow:
    """Sum E meetings up, E / SCENES in a row of each scene."""
    arrived = met.arrival[np.isfinite(met.arrival)]
    return MeetingRow(
        settings=settings,
        seed=seed,
        scenes=SCENES,
        episodes=len(met.side),
        left=_percent(met.side == 1),
        right=_percent(met.side == -1),
        stand_off=_percent(met.side == 0),
        two_ways=_percent(two_ways(met.side.reshape(SCENES, -1))),
        collided=_percent(met.collided),
        seconds_to_goal=float(np.median(arrived)) * FACTS.dynamics.dt_s if len(arrived) else None,
        policy=policy,
        commit=commit(),
    )


def two_ways(side: np.ndarray) -> np.ndarray:
    """Scenes (S,) whose episodes (S, E), 1, -1 or 0, take either side often enough."""
    passes = np.maximum((side != 0).sum(1), 1)
    rarer = np.minimum((side == 1).sum(1), (side == -1).sum(1))
    return rarer >= np.maximum(RARE * passes, 1)


def modes_table(rows: Sequence[MeetingRow]) -> str:
    """Means over the seeds, in Markdown."""
    names = ("left", "right", "stand_off", "two_ways", "collided")
    lines = []
    for settings in dict.fromkeys(row.settings for row in rows):
        own = [row for row in rows if row.settings == settings]
        times = [row.seconds_to_goal for row in own if row.seconds_to_goal is not None]
        figures = [f"{np.mean([getattr(row, name) for row in own]):.1f}" for name in names]
        lines.append([str(settings), *figures, f"{np.mean(times):.1f}" if times else "never"])
    titles = [*(f"{name.replace('_', ' ')}, %" for name in names), "to the goals, s"]
    return table(["policy", *titles], lines)


def _measure(options: argparse.Namespace) -> tuple[list[MeetingRow], list[Panel]]:
    """All rows, and what is drawn of the first seed's policies."""
    task, rows, panels = TASKS["navigation"], [], []
    angle = np.repeat(2.0 * np.pi * np.arange(SCENES) / SCENES, options.samples)
    for seed in options.seeds:
        for name, settings in contestants().items():
            policy = find_policy(options.policies, task.name, settings.algorithm(task.name), seed)
            met, tracks = meet(decider(task, settings, load_bundle(policy)), angle, seed)
            rows.append(summed_up(settings, seed, met, digest(policy)))
            if seed == options.seeds[0]:
                panels.append(Panel(f"{name}: {settings}", along(tracks[:, :, :2], angle), met.side))
    return rows, most_divided(panels, SCENES)


def _percent(flags: np.ndarray) -> float:
    return 100.0 * float(flags.mean())
