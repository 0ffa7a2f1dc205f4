"""Statuses as robots send them, and a team of which a test decides what was heard when."""

import hashlib

from edge_runtime.telemetry.status import ObjectiveStatus, Span, Status, encode
from edge_runtime.tools.watch.team import WatchedTeam

KEY = hashlib.sha256(b"a key for tests").digest()


def status(robot_id=0, sequence=1, **fields):
    stages = ("wake", "read", "observe", "act", "limit", "write")
    shown = {
        "robot_id": robot_id,
        "started_s": 1000.0,
        "sequence": sequence,
        "sent_s": 1001.0,
        "position_m": (0.1, 0.2),
        "velocity_m_s": (0.12, 0.16),
        "heading_rad": 0.5,
        "yaw_rate_rad_s": 0.0,
        "action": (0.25, -0.5),
        "speed_limit_m_s": 0.3,
        "goal_distance_m": 1.5,
        "nearest_m": 0.4,
        "margin_m": 0.25,
        "rate_hz": 49.9,
        "nominal_rate_hz": 50.0,
        "missed": 0,
        "cut_short": 0,
        "tick": Span(800.0, 12_345.0),
        "stages": {stage: Span(12_345.0, 123_456.0) for stage in stages},
        "objectives": (
            ObjectiveStatus("speed_limit", "0.3 m/s", 0.0, 0.0),
            ObjectiveStatus("safety_margin", "0.25 m", 0.125, 0.4),
        ),
        "objectives_version": 3,
        "ages_s": {1: 0.004, 2: 0.0995, 3: 0.02},
        "stop_reason": "",
    }
    return Status(**{**shown, **fields})


class Clocks:
    """The watcher's two clocks, moved by the test."""

    def __init__(self):
        self.now_s = 0.0

    def monotonic(self):
        return self.now_s

    def wall(self):
        return 1001.0 + self.now_s


def watched(*statuses, robots=4, clocks=None):
    clocks = clocks or Clocks()
    team = WatchedTeam(range(robots), KEY, clocks.monotonic, clocks.wall)
    for each in statuses:
        team.hear(encode(each, KEY))
    return team
