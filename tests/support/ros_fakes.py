"""A node of ROS in memory, whose neighbours are what the test says."""

from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.ros.client import Graph, Topic
from firmware_bridge.ros.profile import load_profile, profile_path

PROFILE = load_profile(profile_path("clearpath_jazzy")).under("/a200_0000")
COMMAND, ODOMETRY, STOP = PROFILE.command, PROFILE.odometry, PROFILE.emergency_stop
TWIST = "geometry_msgs/TwistStamped"
WHOLE = {
    COMMAND: Topic((TWIST,), (), ("/twist_mux",)),
    ODOMETRY: Topic(("nav_msgs/Odometry",), ("/controller",)),
    STOP: Topic(("std_msgs/Bool",), ("/mcu",)),
}


class FakeClient:
    name = "/a200_0000/cfpg_edge_0"
    where = "domain 7"
    settling_s = 0.0

    def __init__(self, inbox) -> None:
        self.inbox, self.graphs, self.arriving = inbox, [Graph(WHOLE)], []
        self.published: list[tuple[BaseMotion, float]] = []
        self.log: list[str] = []
        self.timeout: float | None = 0.5
        self.misfits: tuple[str, ...] = ()

    def connect(self):
        self.log.append("connect")

    def graph(self):
        return self.graphs.pop(0) if len(self.graphs) > 1 else self.graphs[0]

    def parameter(self, name):
        self.log.append(name)
        return self.timeout

    def unheard(self):
        return self.misfits

    def advertise(self):
        self.log.append("advertise")

    def listen(self):
        self.log.append("listen")
        for item in self.arriving:
            self.inbox.put(item)

    def compose(self, motion, stamp_s):
        return motion, stamp_s

    def publish(self, message):
        self.published.append(message)

    def close(self):
        self.log.append("close")
