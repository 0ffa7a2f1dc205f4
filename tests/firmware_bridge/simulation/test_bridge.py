"""The simulated team: one period a read, one command a period, everybody decides on the same states."""

import math
from pathlib import Path

import numpy as np
import pytest
from bundles import MANIFEST, straight_weights

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import Command, TeamState
from edge_runtime.policy.bundle import Bundle
from firmware_bridge.simulation.bridge import open_bridge
from firmware_bridge.simulation.discs import Discs

BUNDLE = Bundle(MANIFEST, straight_weights(), Path())


def mission(rate_hz=10.0, guided=True, robot_id=0, fleet=None):
    fleet = fleet or load_fleet(DEFAULT_FLEET)
    # The hand-made policy passes the flow's start straight on: noise would shake the robots.
    asked = ObjectiveSet(fleet.objective_set.objectives, GuidanceSettings(start_noise=0.0))
    return Mission(robot_id, fleet, BUNDLE, asked, rate_hz, guided=guided)


def drive(bridge, controller, ticks):
    teams = []
    for _ in range(ticks):
        own = bridge.read()
        teams.append(TeamState(own, bridge.teammates()))
        bridge.write(controller.decide(teams[-1], own.stamp_s))
    return teams


def test_the_first_read_shows_the_starts():
    run = mission()
    with open_bridge(run) as bridge:
        own = bridge.read()
        assert own.position_m == run.fleet.robot(0).start_m
        assert own.velocity_m_s == (0.0, 0.0)
        assert [mate.state.robot_id for mate in bridge.teammates()] == [1, 2, 3]
        assert {mate.state.stamp_s for mate in bridge.teammates()} == {own.stamp_s}


def test_a_command_moves_the_robot_for_one_period_only():
    with open_bridge(mission()) as bridge:
        bridge.read()
        bridge.write(Command(0, 0, 0.0, (1.0, -1.0), (0.0, 0.0)))
        assert bridge.read().velocity_m_s == pytest.approx((0.1, -0.1))
        assert bridge.read().velocity_m_s == pytest.approx((0.075, -0.075))


def test_leaving_stops_the_robot():
    with open_bridge(mission()) as bridge:
        bridge.read()
        bridge.write(Command(0, 0, 0.0, (1.0, 1.0), (0.0, 0.0)))
    assert bridge.read().velocity_m_s == (0.0, 0.0)


def test_every_robot_drives_as_if_it_were_the_one_at_the_link():
    """Whichever robot's process looks at the team, the team does the same."""
    runs = []
    for robot_id in (0, 2):
        run = mission(robot_id=robot_id)
        with open_bridge(run) as bridge:
            drive(bridge, run.controller(robot_id), 40)
            runs.append(np.array([motion.position_m for motion in bridge.plant.motions()]))
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-12)


def test_teammates_tell_the_action_that_moved_them():
    run = mission(guided=False)
    with open_bridge(run) as bridge:
        first, second = drive(bridge, run.controller(0), 2)
    assert all(mate.intended_action == (0.0, 0.0) for mate in first.teammates)
    for mate in second.teammates:
        moved = (0.1 * mate.intended_action[0], 0.1 * mate.intended_action[1])
        assert mate.state.velocity_m_s == pytest.approx(moved)
        assert math.hypot(*moved) > 0.05


@pytest.mark.parametrize("rate_hz", [10.0, 25.0])
def test_the_guided_team_reaches_its_goals_apart(rate_hz):
    run = mission(rate_hz)
    with open_bridge(run) as bridge:
        teams = drive(bridge, run.controller(0), int(14 * rate_hz))
    goals = [robot.goal_m for robot in run.fleet.robots]
    assert (
        np.linalg.norm(
            np.array([motion.position_m for motion in bridge.plant.motions()]) - goals, axis=-1
        ).max()
        < 0.1
    )
    for team in teams:
        states = [team.own, *(mate.state for mate in team.teammates)]
        distances = [math.dist(a.position_m, b.position_m) for a in states for b in states if a is not b]
        assert min(distances) > 2 * MANIFEST.body.radius_m


def test_the_plant_runs_at_the_control_period():
    assert isinstance(open_bridge(mission(25.0)).plant, Discs)
    assert open_bridge(mission(25.0)).plant.world.motions[0].dt_s == 0.04


def test_a_team_of_processes_simulates_its_own_robot_only():
    run = mission(robot_id=2, fleet=load_fleet(DEFAULT_FLEET.with_name("udp.toml")))
    with open_bridge(run) as bridge:
        assert bridge.read().position_m == run.fleet.robot(2).start_m
        bridge.write(Command(2, 0, 0.0, (1.0, -1.0), (0.0, 0.0)))
        assert bridge.read().velocity_m_s == pytest.approx((0.1, -0.1))
        assert bridge.teammates() == ()


def test_a_fleet_whose_discs_would_overlap_is_refused(tmp_path):
    path = tmp_path / "near.toml"
    robot = "[[robots]]\nid = {}\nstart_m = [{}, 0]\ngoal_m = [{}, 1]\n"
    path.write_text(robot.format(0, 0.0, 0.0) + robot.format(1, 1.0, 0.15))
    with pytest.raises(
        ConfigError, match=r"robots\[1\].goal_m: 0.150 m from that of robot 0; .* at least 0.2 m"
    ):
        mission(fleet=load_fleet(path))


WALL = """
[[obstacle]]
centre_m = [{}, 0]
radius_m = 0.3
[[objectives]]
type = "obstacle_margin"
distance_m = {}
"""
ALONE = "[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [2, 0]\n"


def test_the_range_sensor_sees_obstacles_and_teammates(tmp_path):
    path = tmp_path / "wall.toml"
    path.write_text(
        ALONE + "[[robots]]\nid = 1\nstart_m = [0, 0.3]\ngoal_m = [2, 1]\n" + WALL.format(0.5, 0.2)
    )
    run = mission(fleet=load_fleet(path))
    with open_bridge(run) as bridge:
        bridge.read()
        readings = bridge.ranges_m()
    assert readings[0] == pytest.approx(0.2)  # along x, at the obstacle
    assert readings[3] == pytest.approx(0.2)  # along y, at the teammate
    assert readings[6] == MANIFEST.body.lidar_range_m
    with open_bridge(mission()) as bridge:
        bridge.read()
        assert bridge.ranges_m() is None


@pytest.mark.parametrize(
    ("obstacle", "complaint"),
    [
        (WALL.format(0.3, 0.2), r"obstacle\[0\].centre_m: 0.300 m from the start of robot 0; .* least 0.4 m"),
        (
            WALL.format(1.0, 0.5),
            "body.lidar_range_m: obstacle_margin needs to see 0.52 m far; allowed with this sensor: 0.35 m",
        ),
    ],
)
def test_obstacles_that_do_not_hold_together(obstacle, complaint, tmp_path):
    path = tmp_path / "wall.toml"
    path.write_text(ALONE + obstacle)
    fleet = load_fleet(path)
    with pytest.raises(ConfigError, match=complaint):
        Mission(0, fleet, BUNDLE, fleet.objective_set, 10.0)
