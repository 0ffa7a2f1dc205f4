"""What a run is judged by, and from when on."""

import math

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.monitor import SETTLE_S, Monitor
from edge_runtime.messages import Command, GuidedAction, RobotState, Teammate, TeamState

COMMAND = Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0))


def test_other_objectives_are_judged_once_the_team_had_time_to_brake():
    monitor = Monitor(load_fleet(DEFAULT_FLEET), 1, 10)

    def follow(time_s, speed_m_s, apart_m):
        own = RobotState(0, time_s, (0.0, 0.0), (speed_m_s, 0.0))
        mate = Teammate(RobotState(1, time_s, (apart_m, 0.0), (0.0, 0.0)))
        monitor.update(TeamState(own, (mate,)), GuidedAction((0.0, 0.0), 10), COMMAND)
        return monitor.robots[0].max_speed_m_s, monitor.robots[0].min_separation_m

    assert follow(5.0, 0.3, 0.25) == (0.3, 0.25)
    monitor.judge_anew(6.0)
    assert not monitor.settled
    assert follow(6.0, 0.3, 0.25) == (0.0, math.inf)
    assert follow(5.9 + SETTLE_S, 0.15, 0.28) == (0.0, math.inf)
    assert follow(6.0 + SETTLE_S, 0.1, 0.3) == (0.1, 0.3)
    assert monitor.settled
