"""Teams on wheels that slip, behind every bridge."""

import importlib
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from ros_peers import DEBIAN, needs_ros1
from sil_reports import LENIENT

from edge_runtime.config.fleet import load_fleet
from edge_runtime.errors import ConfigError
from firmware_bridge.kinematics.base import Base, BaseMotion, motion_for
from firmware_bridge.ros.profile import load_profile, profile_path
from firmware_bridge.sil.firmware.node import STEP_S
from firmware_bridge.sil.firmware.sources import Sources
from firmware_bridge.sil.firmware.truth import Truth
from firmware_bridge.sil.firmware.world import Standing
from firmware_bridge.sil.harness.robots import check_robot
from firmware_bridge.sil.scenario import scenario as scenarios
from firmware_bridge.sil.scenario.scenario import Request, prepare, robot_bundle
from firmware_bridge.sil.scenario.team_file import write_key
from firmware_bridge.sil.scenario.vehicle import Vehicle
from firmware_bridge.simulation.plants import PLANTS
from firmware_bridge.simulation.wheels.bases import BASES

wheeled = pytest.importorskip("firmware_bridge.sil.firmware.wheeled_world", reason="MuJoCo is not installed")
AHEAD_M = 0.4


@pytest.fixture
def scenario(tmp_path):
    return prepare(Request(plant="mujoco", bridge="mavlink", rate_hz=20.0), tmp_path)


@pytest.fixture
def make(scenario):
    """A world of Huskies whose steered points stand where the test puts them."""
    fleet = load_fleet(scenario.stations[0].fleet_file)
    manifest = robot_bundle(fleet, fleet.robots[0], "").manifest

    def world(*standings):
        placed = [Standing(start_m, heading, AHEAD_M) for start_m, heading in standings]
        return wheeled.make_world(fleet, [manifest] * len(placed), placed, STEP_S, 0.05)

    return world


def test_a_generated_team_is_of_huskies_at_their_scale(scenario):
    fleet = scenario.fleet
    assert (fleet.simulation.plant, fleet.simulation.base, fleet.team.scale_m) == ("mujoco", "husky", 6.0)
    assert all(math.hypot(*station.start_m) == pytest.approx(5.4) for station in scenario.stations)
    assert all(robot.pose for robot in fleet.robots)  # slipping wheels do not tell where they are


def test_what_is_steered_stands_where_the_fleet_has_it_and_goes_where_it_is_told(make):
    world = make(((1.0, 2.0), 0.7))
    assert world.position_m[0] == pytest.approx((1.0, 2.0), abs=0.02)
    husky = Base("differential", sideways="lookahead", lookahead_m=AHEAD_M)
    for _ in range(300):
        world.step([motion_for((-0.3, 0.4), world.state(0).heading_rad, husky)])
    assert world.velocity_m_s[0] == pytest.approx((-0.3, 0.4), abs=0.1)
    assert world.position_m[0, 0] < 0.6 and world.position_m[0, 1] > 2.6


def test_what_its_firmware_measures_is_of_the_axle(make):
    world = make(((0.0, 0.0), 0.0))
    for _ in range(200):
        world.step([BaseMotion(0.3, 0.0, 0.5)])
    state = world.state(0)
    x, y = world.position_m[0]
    assert math.dist(state.position_m, (x, y)) == pytest.approx(AHEAD_M)
    assert state.forward_m_s == pytest.approx(0.3, abs=0.05)
    assert abs(state.lateral_m_s) < 0.1
    assert 0.2 < state.yaw_rad_s < 0.6


def test_contacts_are_those_of_the_bases(make):
    """Rear to rear they meet while the points that are steered are far apart; each pair counts once."""
    world = make(((1.2, 0.0), 0.0), ((-1.2, 0.0), math.pi), ((0.0, 5.0), 0.0))
    truth = Truth(world, [None] * 3, (), STEP_S)
    for _ in range(300):
        world.step([BaseMotion(-0.5), BaseMotion(-0.5), BaseMotion()])
        truth.follow()
    assert [outcome.collisions for outcome in truth.outcomes()] == [1, 1, 0]
    assert world.distances_m()[0, 1] > world.radius_m[0] + world.radius_m[1]


OBSTACLES = """
[[obstacle]]
centre_m = [3.0, 0.0]
radius_m = 0.5
[[obstacle]]
centre_m = [0.0, -4.6]
radius_m = 0.2
velocity_m_s = [0.0, 0.5]
"""


@pytest.mark.parametrize("plant", ["discs", "mujoco"])
def test_robots_see_obstacles_of_the_fleet_and_touch_them(tmp_path, plant):
    """What a robot's own file has is a range stream: it knows of no obstacle."""
    write_key(tmp_path / "team.key")
    path = tmp_path / "team.toml"
    path.write_text(
        f'[team]\nscale_m = 6.0\n[simulation]\nplant = "{plant}"\n[carrier]\nkey = "team.key"\n'
        "[[robots]]\nid = 4\naddress = '127.0.0.1:9'\nstart_m = [0.0, 0.0]\ngoal_m = [9.0, 0.0]\n"
        "[[robots]]\nid = 7\naddress = '127.0.0.1:8'\nstart_m = [0.0, -2.0]\ngoal_m = [9.0, 3.0]\n"
        + OBSTACLES
    )
    scenario = prepare(Request(fleet=path, bridge="mavlink", rate_hz=20.0), tmp_path)
    own = load_fleet(Path(scenario.stations[0].fleet_file))
    assert not own.obstacles and all(robot.ranges_place for robot in own.robots)
    assert len(scenario.fleet.obstacles) == 2
    check_robot(scenario, scenario.stations[0])
    manifests = [robot_bundle(own, robot, "").manifest for robot in own.robots]
    standings = [Standing(one.start_m, 0.0, one.vehicle.ahead_m) for one in scenario.stations]
    module = importlib.import_module(PLANTS[plant].world)
    world = module.make_world(scenario.fleet, manifests, standings, STEP_S, 0.05)
    truth = Truth(world, [None] * 2, (), STEP_S)
    sensors = [manifest.body.sensor() for manifest in manifests]
    with Sources(own, world, range_sensors=sensors) as sources:
        (up, down), far_m = (len(sensors[1].rays) // 4, -(len(sensors[1].rays) // 4)), sensors[1].range_m
        assert sources._ranges_m(1)[up] == pytest.approx(2.0 - manifests[0].body.radius_m, abs=0.02)
        assert sources._ranges_m(1)[down] == sources._ranges_m(0)[0] == far_m
        for step in range(round(6.0 / STEP_S)):
            world.step([BaseMotion(0.9), BaseMotion()])
            truth.follow()
            if step == round(2.0 / STEP_S):
                assert sources._ranges_m(1)[down] == pytest.approx(1.4, abs=0.03)
    for outcome in truth.outcomes():  # one ran into an obstacle, into the other one walked
        assert (outcome.obstacle_contacts >= 1, outcome.collisions) == (True, 0)
    assert world.position_m[0, 0] < 2.5 and world.position_m[1, 1] > -1.9


def test_a_fleet_that_its_wheels_do_not_fit_is_refused_before_anything_starts(tmp_path):
    write_key(tmp_path / "team.key")
    path = tmp_path / "team.toml"
    path.write_text(
        '[team]\n[simulation]\nplant = "mujoco"\n[carrier]\nkey = "team.key"\n'
        "[[robots]]\nid = 0\naddress = '127.0.0.1:9'\nstart_m = [0.0, 0.0]\ngoal_m = [1.0, 0.0]\n"
    )
    with pytest.raises(ConfigError, match="makes the policy's robot smaller than a husky"):
        prepare(Request(fleet=path), tmp_path)


@pytest.mark.integration
@pytest.mark.parametrize(
    "bridge", [("can",), ("mavlink",), pytest.param(("ros1", "--ros-path", DEBIAN), marks=needs_ros1)]
)
def test_real_processes_drive_on_wheels_that_slip(tmp_path, bridge):
    """What is judged does not depend on how busy the machine is: all drive, towards their goals."""
    (tmp_path / "lenient.toml").write_text(LENIENT)
    flags = ("--plant", "mujoco", "--robots", "2", "--rate", "10", "--duration", "4", "--bridge", *bridge)
    files = ("--limits", str(tmp_path / "lenient.toml"), "--json", str(tmp_path / "run.json"))
    command = (sys.executable, "-m", "firmware_bridge.sil.edge_sil", *flags, *files)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for robot in json.loads((tmp_path / "run.json").read_text())["robots"]:
        assert robot["goal_distance_m"] < 8.7  # of 10.4 at the start
        assert robot["greatest_speed_m_s"] > 0.3


def test_limos_behind_ros_2_are_steered_as_limos(tmp_path, monkeypatch):
    monkeypatch.setattr(scenarios, "check_ros", lambda *_: None)
    write_key(tmp_path / "team.key")
    path = tmp_path / "team.toml"
    path.write_text(
        '[team]\nscale_m = 2.0\n[simulation]\nplant = "mujoco"\nbase = "limo"\n[carrier]\nkey = "team.key"\n'
        "[[robots]]\nid = 0\naddress = '127.0.0.1:9'\nstart_m = [0.0, 0.0]\ngoal_m = [1.0, 0.0]\n"
    )
    (limo,) = prepare(Request(fleet=path, bridge="ros2", rate_hz=20.0), tmp_path).stations
    (husky,) = prepare(Request(robots=1, plant="mujoco", bridge="ros2", rate_hz=20.0), tmp_path).stations
    profile, shipped = (
        load_profile(profile_path(limo.vehicle.profile)),
        load_profile(profile_path("limo_ros2")),
    )
    assert limo.vehicle.ahead_m == 0.1 and husky.vehicle == Vehicle("clearpath_jazzy", AHEAD_M)
    assert profile.base == shipped.base == BASES["limo"].kinematics
    assert (profile.message, profile.limits) == (shipped.message, shipped.limits)
