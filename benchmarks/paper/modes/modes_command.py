"""``python -m benchmarks.paper.modes.modes_command``: how many ways round each other a policy knows."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import torch

from benchmarks.paper.contestants import FLOWS, Contestant
from benchmarks.paper.evaluation import commit
from benchmarks.paper.methods import unguided
from benchmarks.paper.modes.meetings import Meetings, meet
from benchmarks.paper.modes.picture import Drawn, along, draw_meetings
from benchmarks.paper.policies import POLICIES, digest, load_policy
from benchmarks.paper.tables import markdown
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import chosen, read_tuned
from edge_runtime.common.arrays import Floats
from edge_runtime.common.command_line import command
from export.atomic import write_atomic
from export.scenarios.navigation import FACTS

RESULTS = Path(__file__).parents[2] / "results" / "paper_modes.json"
SCENES = 8
"""Headings, evenly spread."""
SEEDS = (1, 2)
"""Of the policies; guidance was tuned on seed 0."""
RARE = 0.1
"""A scene has two ways if each side gets this share of its passes at least."""


class MeetingRow(msgspec.Struct, frozen=True, kw_only=True):
    """Shares in percent over the meetings of one seed's policy."""

    method: str
    mode: str
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


@command("benchmarks.paper.modes.modes_command")
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write and draw; returns the exit code."""
    options = _parse(arguments)
    torch.set_num_threads(1)
    rows, drawn = _measure(options)
    write_atomic(options.json, msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")
    draw_meetings(drawn, options.json.parent / "paper" / "modes.png")
    print(modes_table(rows))
    return 0


def contestants(default: Contestant) -> list[Contestant]:
    """A flow from samples and from its mean, the tuned default, and MAPPO's mean."""
    flow = FLOWS["navigation"]
    return [
        Contestant("flow", "unguided, noise 1", flow, partial(unguided, start_noise=1.0)),
        Contestant("flow", "unguided, noise 0", flow, partial(unguided, start_noise=0.0)),
        default,
        Contestant("MAPPO", "mean", "mappo", partial(unguided, start_noise=0.0)),
    ]


def summed_up(who: Contestant, seed: int, met: Meetings, policy: str) -> MeetingRow:
    """Sum E meetings up, E / SCENES in a row of each scene."""
    arrived = met.arrival[np.isfinite(met.arrival)]
    return MeetingRow(
        method=who.method,
        mode=who.mode,
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
    for method, mode in dict.fromkeys((row.method, row.mode) for row in rows):
        own = [row for row in rows if (row.method, row.mode) == (method, mode)]
        times = [row.seconds_to_goal for row in own if row.seconds_to_goal is not None]
        figures = [f"{np.mean([getattr(row, name) for row in own]):.1f}" for name in names]
        lines.append([method, mode, *figures, f"{np.mean(times):.1f}" if times else "never"])
    titles = [*(f"{name.replace('_', ' ')}, %" for name in names), "to the goals, s"]
    return markdown(["policy", "mode", *titles], lines)


def _measure(options: argparse.Namespace) -> tuple[list[MeetingRow], list[Drawn]]:
    """All rows, and what is drawn of the first seed's policies."""
    default = chosen(read_tuned(), TASKS["navigation"], "CFPG")
    angle = np.repeat(2.0 * np.pi * np.arange(SCENES) / SCENES, options.samples)
    rows, drawn = [], []
    for seed in options.seeds:
        for who in contestants(replace(default, method="flow", mode=f"CFPG: {default.mode}")):
            bundle = load_policy(options.policies, "navigation", who.algorithm, seed)
            seen: list[Floats] = []
            met = meet(who.make(bundle), angle, seed, seen.append)
            rows.append(summed_up(who, seed, met, digest(bundle)))
            if seed == options.seeds[0]:
                tracks = along(np.stack(seen)[:, :, :2], angle)
                drawn.append(Drawn(f"{who.method}, {who.mode}", tracks, met.side))
    return rows, _most_divided(drawn)


def _most_divided(drawn: Sequence[Drawn]) -> list[Drawn]:
    """Of every contestant's scenes the one in which the first of them is most divided."""
    side = drawn[0].side.reshape(SCENES, -1)
    scene = int(np.minimum((side == 1).sum(1), (side == -1).sum(1)).argmax())
    own = slice(scene * side.shape[1], (scene + 1) * side.shape[1])
    return [replace(panel, tracks=panel.tracks[:, own], side=panel.side[own]) for panel in drawn]


def _percent(flags: np.ndarray) -> float:
    return 100.0 * float(flags.mean())


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.paper.modes.modes_command", description=__doc__
    )
    parser.add_argument("--samples", type=int, default=50, metavar="N", help="episodes of a scene (50)")
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS, help="of the policies (1 2)")
    parser.add_argument("--policies", type=Path, default=POLICIES, metavar="DIR")
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="the rows")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
