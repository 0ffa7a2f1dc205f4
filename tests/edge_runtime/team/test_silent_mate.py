"""A robot that falls silent is an obstacle where it was: the others drive around it by the shipped policy."""

import math

import pytest
from bundles import MANIFEST
from fleet_fakes import PERIOD_S, World, ids
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.config.network import Robot
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import Command, GuidedAction, RobotState
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.bundle import packaged_bundle

MARGIN_M = 0.25
SILENT = 2


class Arena(World):
    """Two robots exchange places; a third drives between them until it stops and says no more."""

    def __init__(self, middle, **rules):
        super().__init__(3, missing_s=1e9, alone_s=1e9, **rules)
        starts = {0: (-0.8, 0.0), 1: (0.8, 0.1), SILENT: middle}
        goals = {0: (0.8, 0.0), 1: (-0.8, 0.1), SILENT: (middle[0], -0.9)}
        fleet = load_fleet(DEFAULT_FLEET)
        robots = tuple(Robot(id=number, start_m=starts[number], goal_m=goals[number]) for number in starts)
        mission = Mission(
            0, replace(fleet, robots=robots), packaged_bundle("navigation"), fleet.objective_set, 1 / PERIOD_S
        )
        self.controllers = {robot.id: mission.controller(robot.id) for robot in robots}
        self.preview = mission.bundle.manifest.motion.at_period(PERIOD_S).preview(1)
        self.position, self.velocity = starts, dict.fromkeys(starts, (0.0, 0.0))

    def own(self, robot_id):
        stamp_s = self.clock(robot_id)
        return RobotState(robot_id, stamp_s, self.position[robot_id], self.velocity[robot_id])

    def drive(self):
        """One period."""
        alive = [robot_id for robot_id in self.teams if robot_id not in self.network.dead]
        views = {robot_id: self.view(robot_id) for robot_id in alive}
        for robot_id, view in views.items():
            command = self.controllers[robot_id].decide(view, self.clock(robot_id))
            self.teams[robot_id].share(view.own, command)
            self.move(robot_id, command.action)
        self.now_s += PERIOD_S
        return views

    def move(self, robot_id, action):
        p, (vx, vy), (x, y), (ux, uy) = self.preview, self.velocity[robot_id], self.position[robot_id], action
        self.position[robot_id] = (
            x + p.position_decay * vx + p.position_gain * ux,
            y + p.position_decay * vy + p.position_gain * uy,
        )
        self.velocity[robot_id] = (
            p.velocity_decay * vx + p.velocity_gain * ux,
            p.velocity_decay * vy + p.velocity_gain * uy,
        )


@settings(max_examples=12, deadline=None)
@given(x=st.floats(-0.25, 0.25), y=st.floats(0.2, 0.5), silent_at=st.integers(15, 60))
def test_the_others_keep_the_margin_to_where_a_silent_robot_stands(x, y, silent_at):
    arena = Arena((x, y))
    for _ in range(silent_at):
        arena.drive()
    arena.network.dead.add(SILENT)
    least = math.inf
    for _ in range(500):
        arena.drive()
        least = min(least, *(math.dist(arena.position[other], arena.position[SILENT]) for other in (0, 1)))
    assert least >= MARGIN_M


def test_a_silent_robot_stands_where_it_was_until_it_is_heard_again():
    world = World(3, missing_s=1e9)
    world.ticks(5)
    world.network.dead.add(SILENT)
    view = world.ticks(50)[-1][0]
    assert ids(view) == [1]
    (mate,) = view.silent
    assert (mate.state.robot_id, mate.state.position_m) == (SILENT, world.position[SILENT])
    assert mate.state.velocity_m_s == mate.intended_action == (0.0, 0.0)
    assert mate.age_s == pytest.approx(50 * PERIOD_S, abs=2 * PERIOD_S)
    world.network.dead.clear()
    view = world.ticks(3)[-1][0]
    assert ids(view) == [1, SILENT]
    assert view.silent == ()


def test_ranges_see_a_silent_robot_as_any_other():
    world = World(2)
    world.position[1] = (0.3, 0.0)
    heard = world.ticks(5)[-1][0]
    world.network.dead.add(1)
    silent = world.ticks(10)[-1][0]
    assert heard.teammates and silent.silent and not silent.teammates
    observer = Observer(MANIFEST, (0.0, 0.0))
    assert observer.observe(heard).tolist() == observer.observe(silent).tolist()


def test_silent_time_is_counted():
    world = World(4, missing_s=1e9)
    monitor = Monitor(load_fleet(DEFAULT_FLEET), 1, 10, ObjectiveSet())
    world.ticks(5)
    world.network.dead.add(SILENT)
    for views in world.ticks(53):
        monitor.update(views[0], GuidedAction((0.0, 0.0), 10), Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0)))
    silent = {robot_id: tally.silent_ticks for robot_id, tally in monitor.robots.items()}
    assert silent == {0: 0, 1: 0, SILENT: pytest.approx(50, abs=1), 3: 0}
