"""``python -m benchmarks husky-ros``: episodes of the case study through genuine ROS.

Four Huskies behind ROS 1, or four LIMOs behind ROS 2, each a real edge-run with its guard: each episode is a
run of edge-sil, from places drawn at random, on the plant ``mujoco``; robots look at their goals at first.
Episodes that the file holds are not driven again, but those are that others on the machine disturbed, which
prove nothing (exit code 3), or that could not be carried to their ends (1).
"""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec
import tomli_w

from benchmarks.common.flags import COUNT, add_result, make_parser
from benchmarks.common.result_file import read_result, replaced, write_result
from benchmarks.husky.cases import ASKED, FRICTIONS, TASK, settings_of
from benchmarks.husky.ros_rows import BASES, ROBOTS, Episode, judged, ros_table
from benchmarks.husky.teams import drawn
from benchmarks.paper.candidates import METHODS
from benchmarks.paper.settings import Guided
from benchmarks.sil.run import edge_sil
from edge_runtime.common.flag_types import whole_number
from edge_runtime.common.toml_file import Table
from edge_runtime.errors import EdgeError
from firmware_bridge.sil.scenario.team_file import write_key

RESULTS: Final = Path(__file__).parents[1] / "results" / "husky_ros.json"
FIRST_SEED: Final = 810_000
RATE_HZ: Final = 20.0
FIRST_PORT: Final = 47000
"""edge-sil moves robots to free ones."""
EPISODE_S: Final = 30.0
"""More than twice what the plant's own episodes took; all of it is driven, and judged."""


def main(arguments: Sequence[str]) -> int:
    """Drive what is missing, print, write the episodes."""
    parser = make_parser("husky-ros", __doc__)
    add = parser.add_argument
    add("--bridge", choices=tuple(BASES), required=True, help="ros1: Huskies; ros2: LIMOs")
    add("--ros-path", action="append", default=[], metavar="DIR", help="as edge-sil's")
    add("--episodes", type=COUNT, default=10, help="(10)")
    add("--first-seed", type=whole_number(0, 10**9), default=FIRST_SEED, metavar="N", help=f"({FIRST_SEED})")
    add_result(parser, RESULTS)
    flags = parser.parse_args(arguments)
    seeds = range(flags.first_seed, flags.first_seed + flags.episodes)
    episodes, failed = read_result(flags.json, list[Episode], default=[]), 0
    for seed in seeds:
        if any(_question(one) == (flags.bridge, seed) and not one.disturbed for one in episodes):
            continue
        try:
            episode = drive(flags.bridge, seed, flags.ros_path)
        except EdgeError as error:
            failed += 1
            print(f"episode {seed}: {error}", file=sys.stderr)
            continue
        words = "; ".join(episode.disturbed) or ("satisfied" if episode.satisfied else "not satisfied")
        print(f"episode {seed}: {words}", flush=True)
        episodes = replaced(episodes, [episode], _question)
        write_result(flags.json, episodes)
    print(ros_table(episodes))
    disturbed = any(one.disturbed for one in episodes if one.bridge == flags.bridge and one.seed in seeds)
    return 1 if failed else 3 if disturbed else 0


def drive(bridge: Literal["ros1", "ros2"], seed: int, ros_path: Sequence[str]) -> Episode:
    """Drive one episode.

    Raises:
        BridgeError: if edge-sil could not carry it to its end, with its words.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_key(folder / "team.key")
        (folder / "team.toml").write_text(tomli_w.dumps(fleet_table(BASES[bridge], seed)))
        flags: list[object] = ["--fleet", folder / "team.toml", "--bridge", bridge]
        flags += ["--rate", RATE_HZ, "--duration", EPISODE_S]
        flags += [word for path in ros_path for word in ("--ros-path", path)]
        return judged(edge_sil(folder, flags, {}), seed)


def fleet_table(base: str, seed: int) -> Table:
    """Return the fleet file of a seed's team, asked what the plant's own episodes ask."""
    asked, places, settings = ASKED[base], drawn([seed], ROBOTS), settings_of(METHODS[0])
    assert isinstance(settings, Guided)  # noqa: S101 - for the type checker
    unit = asked.scale_m
    ways = zip((unit * places.starts[0]).tolist(), (unit * places.goals[0]).tolist(), strict=True)
    guidance = msgspec.to_builtins(settings.guidance)  # TOML has no word for nothing
    return {
        "team": {"policy": TASK, "scale_m": unit},
        "simulation": {"plant": "mujoco", "base": base, "friction": FRICTIONS[0]},
        "carrier": {"type": "udp", "key": "team.key"},
        "robots": [
            {"id": i, "start_m": start, "goal_m": goal, "address": f"127.0.0.1:{FIRST_PORT + i}"}
            for i, (start, goal) in enumerate(ways)
        ],
        "objectives": [
            {"type": "speed_limit", "limit_m_s": asked.limit_m_s, "buffer_m_s": asked.speed_reserve_m_s},
            {"type": "safety_margin", "distance_m": asked.margin_m, "buffer_m": asked.margin_reserve_m},
        ],
        "guidance": {name: value for name, value in guidance.items() if value is not None},
    }


def _question(episode: Episode) -> tuple[str, int]:
    return episode.bridge, episode.seed
