"""The team that ``make run`` drives: whatever the start, inside its limits; in simulated time."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.common.episode import ticks
from edge_runtime.config.fleet import FLEETS, load_fleet
from edge_runtime.run.flags import make_mission, make_parser

MOVED_M = 0.05
"""How far a start may be from the fleet file's."""


def mission(seed):
    """The packaged team, from the file's places for seed 0, from places near them for another."""
    own = make_mission(make_parser().parse_args(["--robot-id", "0", "--seed", str(seed)]))
    draw, most = np.random.default_rng(seed), MOVED_M if seed else 0.0
    moved = [
        replace(robot, start_m=tuple((np.array(robot.start_m) + draw.uniform(-most, most, 2)).tolist()))
        for robot in own.fleet.robots
    ]
    return dataclasses.replace(own, fleet=replace(own.fleet, robots=tuple(moved)))


@pytest.mark.parametrize("seed", range(12))
def test_the_packaged_run_keeps_its_speed_limit_and_its_margin(seed):
    run = mission(seed)
    limit_m_s, margin_m = run.objective_set.speed_limit_m_s, run.objective_set.margin_m
    goals = [robot.goal_m for robot in run.fleet.robots]
    arrived = False
    for bridge, command in ticks(run, 14.0):
        assert not command.stop_reason
        motions = bridge.plant.motions()
        assert max(math.hypot(*each.velocity_m_s) for each in motions) <= limit_m_s
        places = [each.position_m for each in motions]
        assert min(math.dist(*pair) for pair in itertools.combinations(places, 2)) >= margin_m
        arrived |= all(math.dist(*pair) <= 0.1 for pair in zip(places, goals, strict=True))
    assert arrived


def test_the_packaged_teams_of_processes_are_guided_as_the_simulated_one():
    simulated, *others = (
        load_fleet(FLEETS / f"{name}.toml").objective_set for name in ("navigation", "udp", "zenoh")
    )
    assert others == [simulated] * 2
