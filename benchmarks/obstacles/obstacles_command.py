"""``python -m benchmarks obstacles``: whether a team arrives past obstacles that no robot knows of.

Four robots of the packaged policy reach goals past five pillars and two people who walk straight on, in the
built-in simulation. They see these by their range sensors alone. Each world is driven twice: with
`obstacle_margin` beside the speed limit and the safety margin, and without. An episode counts if all robots
held their goals within its time and no two discs ever touched.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from benchmarks.common.episode import ticks
from benchmarks.common.flags import COUNT, add_result, make_parser
from benchmarks.common.result_file import write_result
from benchmarks.obstacles.worlds import world
from edge_runtime.common.flag_types import whole_number
from edge_runtime.control.mission import Mission
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.objectives import Objective, ObstacleMargin, SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import Bundle, packaged_bundle

RESULTS: Final = Path(__file__).parents[1] / "results" / "obstacles.json"
EPISODE_S: Final = 60.0
HOLD_S: Final = 1.0
ASIDE: Final = (SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25))
WAYS: Final[dict[str, tuple[Objective, ...]]] = {
    "with obstacle_margin": (*ASIDE, ObstacleMargin(distance_m=0.2)),
    "without": ASIDE,
}
"""The objectives of each way to drive."""
FIRST_SEED: Final = 1000
"""The objective's distance and the worlds' measures were chosen on seeds below."""


class Row(msgspec.Struct, frozen=True):
    """How many episodes of one way to drive came to what."""

    way: str
    episodes: int
    first_seed: int
    succeeded: int
    """Arrived, and nobody touched anything."""
    arrived: int
    without_contact: int


def main(arguments: Sequence[str]) -> int:
    """Drive all worlds, print, write the rows."""
    parser = make_parser("obstacles", __doc__)
    parser.add_argument("--episodes", type=COUNT, default=100, help="(100)")
    parser.add_argument(
        "--first-seed", type=whole_number(0, 10**9), default=FIRST_SEED, metavar="N", help=f"({FIRST_SEED})"
    )
    add_result(parser, RESULTS)
    flags = parser.parse_args(arguments)
    rows = [measure(way, flags.episodes, flags.first_seed) for way in WAYS]
    for row in rows:
        print(
            f"{row.way}: {row.succeeded} of {row.episodes} arrived without contact "
            f"({row.arrived} arrived, {row.without_contact} had no contact)"
        )
    write_result(flags.json, rows)
    return 0


def measure(way: str, episodes: int, first_seed: int) -> Row:
    """Drive the worlds of so many seeds."""
    bundle, asked = packaged_bundle("navigation"), ObjectiveSet(WAYS[way])
    ends = [drive(seed, bundle, asked) for seed in range(first_seed, first_seed + episodes)]
    return Row(
        way,
        episodes,
        first_seed,
        succeeded=sum(arrived and not touched for arrived, touched in ends),
        arrived=sum(arrived for arrived, _ in ends),
        without_contact=sum(not touched for _, touched in ends),
    )


def drive(seed: int, bundle: Bundle, asked: ObjectiveSet) -> tuple[bool, bool]:
    """Drive through one world; returns whether all robots arrived, and whether anything was touched."""
    fleet = world(seed, asked)
    mission = Mission(0, fleet, bundle, asked, bundle.manifest.control_rate_hz, seed)
    goals, held = [robot.goal_m for robot in fleet.robots], 0
    for bridge, _ in ticks(mission, EPISODE_S):
        places = [motion.position_m for motion in bridge.plant.motions()]
        away_m = np.linalg.norm(np.subtract(places, goals), axis=-1)
        held = held + 1 if away_m.max() <= fleet.team.arrival_m else 0
        if held >= HOLD_S * mission.rate_hz:
            break
    return held >= HOLD_S * mission.rate_hz, bool(bridge.plant.touched)
