"""``python -m benchmarks modes``: how many ways round each other a policy knows."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import torch

from benchmarks.common.flags import COUNT, add_policies, add_result, make_parser
from benchmarks.common.result_file import write_result
from benchmarks.common.result_page import table
from benchmarks.paper.evaluation import commit
from benchmarks.paper.methods import decider
from benchmarks.paper.modes.meetings import along, meet, sides
from benchmarks.paper.modes.picture import draw_meetings
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.settings import UNGUIDED, Mean, Settings
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default
from edge_runtime.policy.bundle import load_bundle

RESULTS = Path(__file__).parents[2] / "results" / "paper_modes.json"
SCENES = 8
"""Headings, evenly spread."""
SEEDS = (1, 2)
"""Of the policies."""
RARE = 0.1
"""A scene has two ways if each side gets this share of its passes at least."""


class MeetingRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Shares in percent over the meetings of one seed's policy."""

    settings: Settings
    seed: int
    """Of the policy's training."""
    episodes: int
    """Of all scenes together."""
    left: float
    """Both kept to their left."""
    right: float
    stand_off: float
    """Never passed."""
    two_ways: float
    """Scenes, in percent, in which either side is taken in a tenth of the passes or more."""
    policy: str
    """Digest of its manifest."""
    commit: str


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("modes", __doc__)
    parser.add_argument("--samples", type=COUNT, default=50, metavar="N", help="episodes of a scene (50)")
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS, help="of the policies (1 2)")
    add_policies(parser)
    add_result(parser, RESULTS)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    task, rows, first = TASKS["navigation"], [], {}
    angle = np.repeat(2.0 * np.pi * np.arange(SCENES) / SCENES, options.samples)
    for seed in options.seeds:
        for name, settings in contestants().items():
            policy = find_policy(options.policies, task.name, settings.algorithm(task.name), seed)
            tracks = along(meet(decider(task, settings, load_bundle(policy)), angle, seed), angle)
            rows.append(summed_up(settings, seed, sides(tracks), digest(policy)))
            first.setdefault(f"{name}: {settings}", tracks)
    write_result(options.json, rows)
    draw_meetings(first, SCENES, options.json.parent / "paper" / "modes.png")
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


def summed_up(settings: Settings, seed: int, side: np.ndarray, policy: str) -> MeetingRow:
    """Sum E meetings' sides up, E / SCENES in a row of each scene."""
    left, right, stand_off = (100.0 * float((side == which).mean()) for which in (1, -1, 0))
    return MeetingRow(
        settings=settings,
        seed=seed,
        episodes=len(side),
        left=left,
        right=right,
        stand_off=stand_off,
        two_ways=100.0 * float(two_ways(side.reshape(SCENES, -1)).mean()),
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
    names, lines = ("left", "right", "stand_off", "two_ways"), []
    for settings in dict.fromkeys(row.settings for row in rows):
        own = [row for row in rows if row.settings == settings]
        figures = [f"{np.mean([getattr(row, name) for row in own]):.1f}" for name in names]
        lines.append([str(settings), *figures])
    return table(["policy", *(f"{name.replace('_', ' ')}, %" for name in names)], lines)
