"""``python -m benchmarks tasks``: the paper's three tasks as ``edge-run --task`` drives them, judged.

The packaged fleet files, policies, objectives and guidance; robots that decide one by one, on the backend
that edge-run takes; VMAS's own physics, in simulated time. Each episode has starts, goals and samples of its
own. `paper` computes the same for many robots at once: both must agree within their errors.
"""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import torch
from msgspec.structs import replace

from benchmarks.common.episode import ticks
from benchmarks.common.flags import COUNT, add_result, make_parser
from benchmarks.common.result_file import read_result, write_result
from benchmarks.paper.beside_tables import beside_tables
from benchmarks.paper.rows import Row
from benchmarks.paper.tasks import TASKS, Task
from edge_runtime.common.flag_types import whole_number
from edge_runtime.config.fleet import FLEETS, Fleet, load_fleet
from edge_runtime.control.mission import Mission, adapted
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import packaged_bundle
from export.scenarios import make_scenario
from export.scenarios.plant import VmasPlant

RESULTS: Final = Path(__file__).parents[1] / "results" / "tasks.json"
TABLES: Final = RESULTS.with_name("paper.json")
FIRST_SEED: Final = 700_000
"""No other evaluation draws its episodes from here on."""


class Driven(msgspec.Struct, frozen=True):
    """Episodes of one task."""

    task: str
    episodes: int
    first_seed: int
    satisfied_percent: float
    """Task and both execution objectives at once."""
    error_percent: float
    """Standard error of that share."""
    nominal: float
    """The nominal objective's mean: successes in percent, payload's distance in m, samples."""
    stopped_ticks: int
    """In which robot 0 was commanded to rest for a fault."""


def main(arguments: Sequence[str]) -> int:
    """Drive the episodes, print, write the rows."""
    parser = make_parser("tasks", __doc__)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"any of {', '.join(TASKS)} (default: all)")
    parser.add_argument("--episodes", type=COUNT, default=100, help="of each (100)")
    parser.add_argument(
        "--first-seed", type=whole_number(0, 10**9), default=FIRST_SEED, metavar="N", help=f"({FIRST_SEED})"
    )
    add_result(parser, RESULTS)
    flags = parser.parse_args(arguments)
    if unknown := [name for name in flags.tasks if name not in TASKS]:
        raise ConfigError(f"unknown task {unknown[0]!r}: choose from {', '.join(TASKS)}")
    torch.set_num_threads(1)
    rows, tables = [], read_result(TABLES, list[Row], default=[])
    for name in flags.tasks or TASKS:
        rows.append(measure(TASKS[name], flags.episodes, flags.first_seed))
        row = rows[-1]
        print(
            f"{row.task}: {row.satisfied_percent:.1f} +- {row.error_percent:.1f} % of {row.episodes} "
            f"episodes satisfied, nominal {row.nominal:.3g}, {row.stopped_ticks} stopped ticks",
            flush=True,
        )
        bundle = packaged_bundle(name)
        print(f"  {beside_tables(row.satisfied_percent, row.error_percent, bundle, tables)}", flush=True)
    write_result(flags.json, rows)
    return 0


def measure(task: Task, episodes: int, first_seed: int) -> Driven:
    """Drive the episodes of so many seeds, passing over those whose robots would start within each other."""
    seeds = (seed for seed in itertools.count(first_seed) if stands_apart(task, seed))
    ends = [drive(task, seed) for seed in itertools.islice(seeds, episodes)]
    satisfied, nominal, stopped = (np.array(values, np.float64) for values in zip(*ends, strict=True))
    share, factor = float(satisfied.mean()), task.metrics[0].factor
    error = math.sqrt(share * (1.0 - share) / episodes)
    mean = factor * float(nominal.mean())
    return Driven(task.name, episodes, first_seed, 100 * share, 100 * error, mean, int(stopped.sum()))


def stands_apart(task: Task, seed: int) -> bool:
    """Whether an episode's robots have room: a training's world may put them into each other."""
    fleet = drawn(load_fleet(FLEETS / f"{task.name}.toml"), task.name, seed)
    diameter = 2.0 * packaged_bundle(task.name).manifest.body.radius_m
    starts = [robot.start_m for robot in fleet.robots]
    return all(math.dist(*pair) >= diameter for pair in itertools.combinations(starts, 2))


def drive(task: Task, seed: int) -> tuple[bool, float, int]:
    """Drive one episode; returns whether all was satisfied, the nominal metric, and the stopped ticks."""
    fleet = drawn(load_fleet(FLEETS / f"{task.name}.toml"), task.name, seed)
    bundle = adapted(packaged_bundle(task.name), fleet.robots[0], fleet.team)
    rate_hz = bundle.manifest.control_rate_hz
    mission = Mission(fleet.robots[0].id, fleet, bundle, fleet.objective_set, rate_hz, seed)
    judge, stopped = task.judge(1), 0
    steps = ticks(mission, (task.steps + 1) / rate_hz, "vmas")
    for tick, (bridge, command) in zip(itertools.count(), steps):  # the shorter ends it
        stopped += bool(command.stop_reason)
        if tick and isinstance(bridge.plant, VmasPlant):
            judge.add(bridge.plant.world, bridge.plant.transition)
        if not judge.running.any():
            break
    outcome = judge.outcome()
    return bool(outcome.satisfied[0]), float(outcome.nominal[0]), stopped


def drawn(fleet: Fleet, task: str, seed: int) -> Fleet:
    """Return the fleet with starts, goals and world of an episode's own."""
    state = make_scenario(task, 1, seed, torch.device("cpu"), training=False).state_dict()
    places = {name: value[0].double().tolist() for name, value in state.items() if name != "generator"}
    pair = lambda values: (values[0], values[1])  # noqa: E731
    goals = places.get("goal", [])
    robots = tuple(
        replace(
            robot,
            start_m=pair(places["position"][index]),
            goal_m=pair(goals[index]) if robot.goal_m else None,
        )
        for index, robot in enumerate(fleet.robots)
    )
    tracked = tuple(
        replace(each, start_m=pair(places[each.name]), goal_m=pair(goals) if each.goal_m else None)
        for each in fleet.tracked
    )
    return replace(
        fleet, robots=robots, tracked=tracked, simulation=replace(fleet.simulation, scenario=task, seed=seed)
    )
