"""Wheels that slip against closed forms, and fleets on them by edge-run."""

import json
import math

import numpy as np
import pytest
from clocks import simulated_time
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.common.episode import ticks
from edge_runtime.config.fleet import FLEETS, Obstacle
from edge_runtime.messages import Command
from edge_runtime.run.edge_run import main as edge_run
from edge_runtime.run.flags import make_mission, make_parser
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.simulation.plants import open_plant

pytest.importorskip("mujoco", reason="--plant mujoco needs it")
from firmware_bridge.simulation.wheels.bases import BASES
from firmware_bridge.simulation.wheels.mjcf import GRAVITY_M_S2
from firmware_bridge.simulation.wheels.team import WheeledTeam

SKIDDING = ["husky", "limo"]
speeds = st.floats(-0.9, 0.9)
turns = st.floats(-1.0, 1.0)


def alone(name, friction=1.0, payload_kg=0.0, heading_rad=0.0):
    return WheeledTeam(BASES[name], [(0.0, 0.0)], [heading_rad], friction, payload_kg)


@pytest.mark.parametrize("name", BASES)
def test_a_robot_at_rest_stays(name):
    team = alone(name, payload_kg=2.0)
    team.step([BaseMotion()], 2.0)
    assert np.allclose(team.state(0).position_m, 0.0, atol=1e-3)
    assert np.allclose(team.state(0)[1:], 0.0, atol=1e-3)


@pytest.mark.parametrize("name", BASES)
@settings(max_examples=4, deadline=None)
@given(speed=speeds, heading=st.floats(-3.0, 3.0), payload=st.floats(0.0, 1.0))
@example(speed=0.5, heading=5e-324, payload=2e-313)
def test_where_the_ground_grips_a_robot_is_where_dead_reckoning_has_it(name, speed, heading, payload):
    """After v / a of acceleration and a while at v: v^2 / 2 a + v t."""
    team, seconds = alone(name, 1.0, payload, heading), 2.0
    team.step([BaseMotion(speed)], seconds)
    way_m = speed * (seconds - 0.5 * abs(speed) / BASES[name].acceleration_m_s2)
    wanted = way_m * math.cos(heading), way_m * math.sin(heading)
    assert team.state(0).position_m == pytest.approx(wanted, abs=0.01 + 0.02 * abs(way_m))
    assert team.state(0).forward_m_s == pytest.approx(speed, abs=5e-3)


@pytest.mark.parametrize("friction", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("name", SKIDDING)
@settings(max_examples=3, deadline=None)
@given(turn=turns)
def test_a_base_that_skids_turns_as_coulomb_says(name, friction, turn):
    """Wheels' moments ahead and sideways balance where rims go by (B + L^2 / B) / 2 of the yaw rate."""
    team, base = alone(name, friction), BASES[name]
    team.step([BaseMotion(0.0, 0.0, turn)], 3.0)
    skidding = base.track_m + base.wheelbase_m**2 / base.track_m
    assert team.state(0).yaw_rad_s == pytest.approx(
        turn * base.separation_m / skidding, abs=0.07 * abs(turn) + 1e-3
    )


@settings(max_examples=4, deadline=None)
@given(ahead=speeds, left=speeds, turn=turns)
def test_rollers_let_a_base_move_sideways_and_turn_at_once(ahead, left, turn):
    team = alone("limo_mecanum")
    team.step([BaseMotion(ahead, left, turn)], 3.0)
    state = team.state(0)
    assert (state.forward_m_s, state.left_m_s) == pytest.approx((ahead, left), abs=0.04)
    assert state.yaw_rad_s == pytest.approx(turn, abs=0.01)


@pytest.mark.parametrize("name", SKIDDING)
def test_no_other_base_is_moved_sideways(name):
    team = alone(name)
    team.step([BaseMotion(0.0, 0.5)], 2.0)
    assert team.state(0).position_m == pytest.approx((0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize("payload_kg", [0.0, 2.0])
@pytest.mark.parametrize("friction", [0.05, 0.1])
@pytest.mark.parametrize("name", SKIDDING)
def test_a_robot_on_ice_needs_the_way_that_friction_gives_it(name, friction, payload_kg):
    """v^2 / (2 mu g), whatever it weighs; it took as long to get to that speed."""
    team = alone(name, friction, payload_kg)
    team.step([BaseMotion(1.0)], 4.0)
    before = team.state(0)
    team.step([BaseMotion()], 4.0)
    way_m = team.state(0).position_m[0] - before.position_m[0]
    assert way_m == pytest.approx(before.forward_m_s**2 / (2.0 * friction * GRAVITY_M_S2), rel=0.05)


def test_less_friction_never_brakes_sooner():
    ways = []
    for friction in (0.1, 0.3, 0.7, 1.0):
        team = alone("husky", friction)
        team.step([BaseMotion(1.0)], 3.0)
        before = team.state(0).position_m[0]
        team.step([BaseMotion()], 3.0)
        ways.append(team.state(0).position_m[0] - before)
    assert ways == sorted(ways, reverse=True)
    assert ways[-1] > 1.0 / (2.0 * BASES["husky"].acceleration_m_s2)


@pytest.mark.parametrize("name", BASES)
def test_robots_that_meet_push_each_other_alike(name):
    length = BASES[name].size_m[0]
    team = WheeledTeam(BASES[name], [(-length, 0.0), (length, 0.0), (0.0, 9.0)], [0.0, math.pi, 0.0], 0.7)
    while not team.touched:
        team.step([BaseMotion(0.5), BaseMotion(0.5), BaseMotion(0.2)], 0.01)
    team.step([BaseMotion(0.5), BaseMotion(0.5), BaseMotion(0.2)], 0.3)
    (x, _), (other_x, _) = team.state(0).position_m, team.state(1).position_m
    assert x + other_x == pytest.approx(0.0, abs=0.02 * length)
    assert other_x - x == pytest.approx(length, rel=0.05)
    assert team.touched == {(0, 1)}


def with_obstacles(*obstacles, positions=((0.0, 0.0),), payload_kg=0.0):
    return WheeledTeam(BASES["husky"], positions, [0.0] * len(positions), 0.7, payload_kg, obstacles)


@pytest.mark.parametrize("payload_kg", [0.0, 20.0])
def test_a_pillar_holds_whoever_runs_into_it(payload_kg):
    free, pillar = with_obstacles(payload_kg=payload_kg), Obstacle((1.2, 0.0), 0.3)
    held = with_obstacles(pillar, Obstacle((1.2, 0.5), 0.3), payload_kg=payload_kg)
    for team in (free, held):
        team.step([BaseMotion(0.5)], 0.7)
    assert held.state(0).forward_m_s == pytest.approx(free.state(0).forward_m_s, abs=1e-6)
    assert not held.touched
    held.step([BaseMotion(0.5)], 2.3)
    nose = held.state(0).position_m[0] + BASES["husky"].size_m[0] / 2
    assert nose == pytest.approx(1.2 - 0.3, abs=0.03)
    assert held.touched == {(0, 1)}  # obstacles that overlap do not count
    assert held.obstacles() == [(1.2, 0.0, 0.3), (1.2, 0.5, 0.3)]


def test_who_walks_walks_on_whoever_is_in_the_way():
    walker = Obstacle((-0.6, -1.0), 0.2, (0.3, 0.4))
    team = with_obstacles(walker, Obstacle((0.0, 5.0), 0.1), positions=((0.0, 0.0), (9.0, 0.0)))
    before = team.state(1)
    for _ in range(20):
        team.step([BaseMotion()] * 2, 0.1)
    assert team.obstacles()[0] == pytest.approx((0.0, -0.2, 0.2))
    assert team.obstacles()[1] == (0.0, 5.0, 0.1)
    assert team.touched == {(0, 2)}
    assert team.state(0).position_m[1] > 0.05  # pushed aside
    assert math.dist(team.state(1).position_m, before.position_m) < 1e-3


def test_the_same_commands_give_the_same_motion():
    def drive():
        draw = np.random.default_rng(3)
        team = WheeledTeam(BASES["husky"], [(0.0, 0.0), (1.2, 0.0)], [0.0, 3.0], 0.5, 10.0)
        for _ in range(30):
            team.step([BaseMotion(v, 0.0, w) for v, w in draw.uniform(-1.0, 1.0, (2, 2))], 0.05)
        return [team.state(robot) for robot in range(2)], team.touched

    assert drive() == drive()


def test_periods_that_are_no_whole_steps_add_up():
    slow, fast = alone("husky"), alone("husky")
    slow.step([BaseMotion(0.5, 0.0, 0.3)], 1.0)
    for _ in range(30):
        fast.step([BaseMotion(0.5, 0.0, 0.3)], 1.0 / 30.0)
    assert fast.state(0) == slow.state(0)


def write(folder, *changes):
    text = (FLEETS / "husky.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "team.toml"
    path.write_text(text)
    return path


def test_the_plant_keeps_the_protocol(tmp_path):
    mission = make_mission(make_parser().parse_args(["--robot-id", "0", "--fleet", str(write(tmp_path))]))
    plant, fleet = open_plant(mission), mission.fleet
    before = plant.motions()
    for motion, robot in zip(before, fleet.robots, strict=True):
        assert motion.position_m == pytest.approx(robot.start_m, abs=2e-3)
        assert motion.heading_rad == pytest.approx(robot.start_heading_rad, abs=1e-3)
    plant.drive([Command(robot.id, 0, 0.0, (0.5, 0.25), (0.5, 0.1)) for robot in fleet.robots])
    assert plant.motions() != before
    with pytest.raises(KeyError):
        plant.reading(0, "nearby_samples")
    plant.reset()
    assert plant.motions() == before
    assert not (plant.touched or plant.objects() or plant.obstacles())


def test_the_point_of_reference_goes_where_it_is_told(tmp_path):
    """Ahead of the axle, in any direction; sideways by the yaw rate."""
    mission = make_mission(make_parser().parse_args(["--robot-id", "0", "--fleet", str(write(tmp_path))]))
    plant, told = open_plant(mission), (0.2, -0.15)
    for _ in range(30):
        plant.drive([Command(robot.id, 0, 0.0, (0.0, 0.0), told) for robot in mission.fleet.robots])
        seen = [motion.velocity_m_s for motion in plant.motions()]
    assert np.allclose(seen, told, atol=0.02)


WORLD = """
[[obstacle]]
centre_m = [0.3, 0.4]
radius_m = 0.3
[[obstacle]]
centre_m = [2.0, -7.0]
radius_m = 0.25
velocity_m_s = [-0.3, 0.6]
[[objectives]]
type = "obstacle_margin"
distance_m = 1.2
[guidance]"""


def test_robots_see_obstacles_and_get_past_them(tmp_path):
    path = write(tmp_path, ("[guidance]", WORLD))
    mission = make_mission(make_parser().parse_args(["--robot-id", "0", "--fleet", str(path)]))
    touched = []
    for bridge, _ in ticks(mission, 30.0):
        x, y, radius = bridge.plant.obstacles()[1]
        seen = bridge.ranges_m()
        touched = bridge.plant.touched
    assert (x, y, radius) == pytest.approx((2.0 - 0.3 * 30.0, -7.0 + 0.6 * 30.0, 0.25), abs=0.2)
    assert len(seen) == 12
    assert not touched


@pytest.mark.parametrize("base", BASES)
def test_a_fleet_on_wheels_arrives_without_contact(tmp_path, base):
    changes = [('base = "husky"', f'base = "{base}"')]
    with simulated_time():
        line = ["--robot-id", "0", "--fleet", str(write(tmp_path, *changes)), "--no-log"]
        assert edge_run([*line, "--json", str(tmp_path / "run.json")]) == 0
    report = json.loads((tmp_path / "run.json").read_text())
    assert report["stop_reason"] == "goals held"
    assert report["faults"] == {}


REFUSED = [
    ([("scale_m = 6.0", "scale_m = 2.0")], "team.scale_m: 2 makes the policy's robot smaller than a husky"),
    ([("friction = 0.7", "friction = 0.0")], "simulation: `friction` must lie in [0.05, 1], got 0"),
    ([("# payload_kg = 20.0", "payload_kg = -1.0")], "simulation: `payload_kg` must lie in [0, 100], got -1"),
    ([('base = "husky"', 'base = "jackal"')], "simulation.base:"),
    (
        [
            ("start_m = [4.8, -4.2]\nstart_heading_rad = 2.4", "start_m = [-3.5, -3.6]"),
            ("start_heading_rad = 0.8", "start_heading_rad = 3.1"),
        ],
        "robots[1].start_m: this husky and that of robots[0] overlap",
    ),
    (  # behind the robot, whose point of reference is far enough away
        [("[guidance]", "[[obstacle]]\ncentre_m = [-5.42, -4.24]\nradius_m = 0.2\n[guidance]")],
        "obstacle[0].centre_m: it and the husky of robots[0] overlap at the start",
    ),
]


@pytest.mark.parametrize(("changes", "wanted"), REFUSED)
def test_what_does_not_fit_the_base_is_refused_in_one_line(tmp_path, capsys, changes, wanted):
    assert edge_run(["--robot-id", "0", "--fleet", str(write(tmp_path, *changes)), "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert wanted in line


def test_a_robots_small_install_is_told_what_the_plant_needs(monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    assert edge_run(["--robot-id", "0", "--task", "husky", "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs a workstation's mujoco; run: pip install 'cfpg-edge[mujoco]'" in line
