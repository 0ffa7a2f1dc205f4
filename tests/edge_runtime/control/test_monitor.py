"""What a run is judged by, and from when on."""

import math

import pytest
from msgspec.structs import replace

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.judgement import SETTLE_S
from edge_runtime.control.monitor import WAITS, Monitor
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import Command, GuidedAction, RobotState, Teammate, TeamState
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import SafetyMargin, SpeedLimit

COMMAND = Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0))
FIRST = ObjectiveSet((SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)))
OTHER = ObjectiveSet((SpeedLimit(limit_m_s=0.2), SafetyMargin(distance_m=0.4)))
GUIDE = replace(make_guide(OTHER, PointForce(1.0, 0.25, 0.1, 2)), version=1)


@pytest.fixture
def monitor():
    return Monitor(load_fleet(DEFAULT_FLEET), 1, 10, FIRST)


def follow(monitor, time_s, speed_m_s, apart_m, **view):
    own = RobotState(0, time_s, (0.0, 0.0), (speed_m_s, 0.0))
    mate = Teammate(RobotState(1, time_s, (apart_m, 0.0), (0.0, 0.0)))
    monitor.update(TeamState(own, (mate,), **view), GuidedAction((0.0, 0.0), 10), COMMAND)


def test_each_set_of_objectives_is_judged_over_its_own_time_and_the_whole_run_forgets_nothing(monitor):
    follow(monitor, 5.0, 0.29, 0.245)
    monitor.judge_anew(GUIDE, 6.0)
    follow(monitor, 6.0, 0.3, 0.24)  # it must first brake, and part
    follow(monitor, 5.9 + SETTLE_S, 0.25, 0.3)
    follow(monitor, 6.0 + SETTLE_S, 0.1, 0.45)
    first, other = (judging.judgement(0.1) for judging in monitor.judged)
    assert (first.version, first.min_separation_m, first.max_speed_m_s) == (0, 0.245, 0.29)
    assert (first.safety_margin_m, first.speed_limit_m_s, first.judged_s) == (0.25, 0.3, 0.1)
    assert (other.version, other.min_separation_m, other.max_speed_m_s) == (1, 0.45, 0.1)
    assert (other.safety_margin_m, other.speed_limit_m_s, other.judged_s) == (0.4, 0.2, 0.1)
    assert (monitor.robots[0].max_speed_m_s, monitor.robots[0].min_separation_m) == (0.3, 0.24)


def test_right_after_a_change_what_is_known_stays_known(monitor):
    follow(monitor, 5.0, 0.29, 0.245)
    monitor.judge_anew(GUIDE, 6.0)
    follow(monitor, 6.1, 0.29, 0.3)
    assert monitor.judged[-1].judgement(0.1).judged_s == 0.0
    assert monitor.robots[0].min_separation_m == 0.245


def test_who_was_silent_counts_for_the_set_of_that_time(monitor):
    follow(monitor, 5.0, 0.1, 1.0, silent=(Teammate(RobotState(2, 0.0, (3.0, 0.0), (0.0, 0.0))),))
    monitor.judge_anew(GUIDE, 6.0)
    follow(monitor, 6.0 + SETTLE_S, 0.1, 1.0)
    assert [judging.judgement(0.5).silent_s for judging in monitor.judged] == [{2: 0.5}, {}]


def test_why_the_robot_stands(monitor):
    monitor.no_state()
    assert monitor.stop_reason == WAITS
    follow(monitor, 5.0, 0.1, math.inf)
    assert monitor.stop_reason == ""
    monitor.update(
        TeamState(RobotState(0, 5.1, (0.0, 0.0), (0.0, 0.0))),
        GuidedAction((0.0, 0.0), 10),
        replace(COMMAND, stop_reason="robot 2 was not heard for 30 s"),
    )
    assert monitor.stop_reason == "robot 2 was not heard for 30 s"
