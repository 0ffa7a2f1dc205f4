"""``python -m benchmarks rate``: what another control rate does to a policy that was trained at 10 Hz.

Four robots of the packaged Navigation policy exchange places at random in the built-in simulation, at each
rate the same ones, guided by speed limit and safety margin, and left alone. The plant is the manifest's at
every rate; a tick's commands hold until the next. An episode is a success if all robots held their goals
within its time and no two touched; speeding and margin are shares of the time, and *multi-objective* is a
success with each of them in at most 10 % of it.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from benchmarks.common.episode import ticks
from benchmarks.common.flags import COUNT, add_result, make_parser
from benchmarks.common.result_file import write_result
from benchmarks.common.result_page import table
from benchmarks.obstacles.worlds import scattered
from edge_runtime.config.fleet import Fleet, Team
from edge_runtime.config.network import Robot
from edge_runtime.control.mission import Mission
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import Bundle, packaged_bundle

RESULTS: Final = Path(__file__).parent / "results" / "rate.json"
RATES_HZ: Final = (5.0, 10.0, 20.0, 50.0, 100.0)
ROBOTS, ARENA_M, APART_M = 4, 1.0, 0.5
EPISODE_S: Final = 15.0
HOLD_S: Final = 1.0
LIMIT_M_S, MARGIN_M, TOLERATED = 0.3, 0.25, 0.1
ASKED: Final = ObjectiveSet((SpeedLimit(limit_m_s=LIMIT_M_S), SafetyMargin(distance_m=MARGIN_M)))


class Row(msgspec.Struct, frozen=True):
    """What came of one rate."""

    rate_hz: float
    guided: bool
    episodes: int
    success_share: float
    multi_objective_share: float
    arrival_s: float | None
    """Mean time until all were at their goals, of the successes; None without any."""
    speeding_share: float
    margin_share: float
    """Shares of the time in which a robot was too fast, two were too near."""
    action_change_per_s: float
    """Mean path of one robot's action, in its unit: how restless the commands are."""


class Episode(NamedTuple):
    """What came of one episode."""

    arrival_s: float
    """Infinite where not all robots held their goals, or two touched."""
    speeding: float
    margin: float
    action_change_per_s: float


def main(arguments: Sequence[str]) -> int:
    """Drive at all rates, print, write the rows."""
    parser = make_parser("rate", __doc__)
    parser.add_argument("--episodes", type=COUNT, default=500, help="of each row (500)")
    add_result(parser, RESULTS)
    flags = parser.parse_args(arguments)
    bundle = packaged_bundle("navigation")
    rows = [measure(rate, bundle, flags.episodes, guided=g) for g in (True, False) for rate in RATES_HZ]
    print(rate_table(rows))
    write_result(flags.json, rows)
    return 0


def measure(rate_hz: float, bundle: Bundle, episodes: int, *, guided: bool) -> Row:
    """Drive the episodes of so many seeds."""
    found = [drive(seed, rate_hz, bundle, guided=guided) for seed in range(episodes)]
    arrival, speeding, margin, change = np.array(found).T
    success = np.isfinite(arrival)
    kept = success & (speeding <= TOLERATED) & (margin <= TOLERATED)
    mean_s = float(arrival[success].mean()) if success.any() else None
    shares = (float(success.mean()), float(kept.mean()))
    return Row(
        rate_hz,
        guided,
        episodes,
        *shares,
        mean_s,
        float(speeding.mean()),
        float(margin.mean()),
        float(change.mean()),
    )


def drive(seed: int, rate_hz: float, bundle: Bundle, *, guided: bool) -> Episode:
    """Drive from one seed's starts to its goals."""
    fleet = exchange(seed)
    mission = Mission(0, fleet, bundle, ASKED, rate_hz, seed, guided=guided)
    goals = [robot.goal_m for robot in fleet.robots]
    speeds, nearest, actions, there = [], [], [], []
    for bridge, command in ticks(mission, EPISODE_S):
        motions = bridge.plant.motions()
        places = np.array([motion.position_m for motion in motions])
        apart = np.linalg.norm(places[:, None] - places, axis=-1) + 1e9 * np.eye(ROBOTS)
        speeds.append(max(math.hypot(*motion.velocity_m_s) for motion in motions))
        nearest.append(apart.min())
        actions.append(command.action)
        there.append(np.linalg.norm(places - goals, axis=-1).max() <= fleet.team.arrival_m)
        hold = round(HOLD_S * rate_hz)
        if len(there) >= hold and all(there[-hold:]):
            break
    held = all(there[-hold:]) and not bridge.plant.touched
    change = np.linalg.norm(np.diff(actions, axis=0), axis=-1).mean() * rate_hz
    return Episode(
        len(there) / rate_hz - HOLD_S if held else np.inf,
        float(np.mean(np.array(speeds) > LIMIT_M_S)),
        float(np.mean(np.array(nearest) < MARGIN_M)),
        float(change),
    )


def exchange(seed: int) -> Fleet:
    """Draw a team's starts and goals."""
    draw = np.random.default_rng(seed)
    starts, goals = (scattered(draw, ROBOTS, ARENA_M, APART_M) for _ in range(2))
    robots = tuple(Robot(i, start, goal) for i, (start, goal) in enumerate(zip(starts, goals, strict=True)))
    return Fleet(Path(f"exchange {seed}"), Team(), robots, ASKED)


def rate_table(rows: Sequence[Row]) -> str:
    """Format the rows as a Markdown table."""
    head = [
        "rate Hz",
        "guided",
        "success %",
        "multi-objective %",
        "arrival s",
        "speeding %",
        "margin %",
        "change of action N/s",
    ]
    lines = [
        [
            f"{row.rate_hz:g}",
            "yes" if row.guided else "no",
            f"{100 * row.success_share:.0f}",
            f"{100 * row.multi_objective_share:.0f}",
            "-" if row.arrival_s is None else f"{row.arrival_s:.1f}",
            f"{100 * row.speeding_share:.1f}",
            f"{100 * row.margin_share:.1f}",
            f"{row.action_change_per_s:.1f}",
        ]
        for row in rows
    ]
    return table(head, lines)
