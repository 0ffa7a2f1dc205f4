"""A ROS robot as the guard's Link: what threads of the client bring is judged in the guard's one."""

import importlib
import math
import select
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

import msgspec
from msgspec.structs import replace

from edge_runtime.common.realtime import leave_realtime, switch_threads_often
from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState
from firmware_bridge.guard.link import Condition, Health, Setpoint, Steps
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.kinematics.base import BaseMotion, motion_for, turning
from firmware_bridge.ros.client import Client, Graph, Item, Pressed, Sight, Taken
from firmware_bridge.ros.emergency_stop import EmergencyStop
from firmware_bridge.ros.inbox import Inbox
from firmware_bridge.ros.odometry import Odometer, Odometry, Origin
from firmware_bridge.ros.opening import discover, lost, missing, rivals_said
from firmware_bridge.ros.profile import RosProfile, load_profile

STANDSTILL: Final = BaseMotion()
OPENING_S: Final = 10.0
"""For finding the robot's nodes, and once more for its first odometry."""
STOP_HEARD_S: Final = 1.0
"""For the emergency stop's state, where somebody publishes it; longer where it may be silent for longer."""


class RosOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the guard's specification carries for this link."""

    ros: Literal[1, 2]
    profile: str
    """Path of the profile's TOML file."""
    namespace: str = ""
    origin: Origin = Origin()
    python_path: tuple[str, ...] = ()
    """Folders of ROS's Python packages; where empty, the profile's."""
    turns: bool = False
    """Whether the policy commands yaw rates."""


class RosLink:
    """One ROS robot; implements ``Link``.

    Args:
        profile: the robot's, names absolute.
        client: one node, not yet connected.
        inbox: into which the client puts what it hears.
        odometer: of this robot.
    """

    keepalive_period_s = math.inf

    def __init__(self, profile: RosProfile, client: Client, inbox: Inbox[Item], odometer: Odometer) -> None:
        self.firmware_timeout_s = profile.firmware_timeout_s
        self.recoveries = profile.recoveries
        self.emergency_stop = EmergencyStop(profile)
        self._profile = profile
        self._client = client
        self._inbox = inbox
        self._odometer = odometer
        self._sight: Sight | None = None
        self._operator = ""
        self._trouble = ""
        self._enabled = False

    def open(self) -> None:
        """Find the robot in ROS's graph, refuse what does not fit, and hear it.

        A runtime in real time has its guard inherit that. This one gives it back before ROS's library begins
        its threads: nobody has shown that they always sleep, and they would lock out all else.

        Raises:
            ConfigError: if a topic carries another type than the profile's.
            BridgeError: if ROS or the robot is not there, somebody else has it, or it is silent.
        """
        leave_realtime()
        switch_threads_often()
        self._client.connect()
        graph = self._find()
        if self._profile.timeout_parameter:
            self.firmware_timeout_s = self._client.parameter(self._profile.timeout_parameter)
        self._client.advertise()
        self._client.listen()
        self._await(self._heard, OPENING_S)
        if not self._heard():
            raise BridgeError(f"{self._silence()} within {OPENING_S:g} s ({self._client.where})")
        stop = self._profile.emergency_stop
        if stop and graph.topic(stop).publishers:
            self.emergency_stop.expect(time.monotonic())
            silent_s = self._profile.emergency_stop_silent_s or 0.0
            self._await(lambda: self.emergency_stop.pressed is not None, max(silent_s, STOP_HEARD_S))
        health = self.health(time.monotonic())
        if health.condition in (Condition.OVERRIDE, Condition.LOST):
            raise BridgeError(health.detail)

    def close(self) -> None:
        """Leave ROS."""
        self._client.close()
        self._inbox.close()

    def filenos(self) -> tuple[int, ...]:
        """What rings when the client's threads brought something."""
        return (self._inbox.fileno(),)

    def receive(self, now_s: float) -> None:
        """Take in what has arrived.

        Raises:
            BridgeError: if a topic is flooded.
        """
        for item in self._inbox.take():
            self._take(item, now_s)

    def health(self, now_s: float) -> Health:
        """Judge: who has the robot goes before whether it hears us, that before its odometry."""
        if taken := self._taken():
            return Health(Condition.OVERRIDE, taken)
        if self._trouble or not (self._sight and self._sight.listeners):
            return Health(Condition.LOST, self._trouble or f"nobody listens on {self._profile.command}")
        if fault := self._fault(now_s):
            return Health(Condition.FAULT, fault)
        warning = self._odometer.warning
        if not self._enabled:
            return Health(Condition.WAITING, "not enabled by this guard: pass --arm", warning)
        return Health(Condition.READY, warning=warning)

    def state(self) -> RobotState | None:
        """Return where the odometry has the robot."""
        return self._odometer.state

    def dropped(self) -> int:
        """ROS does not say which messages it drops."""
        return 0

    def send(self, setpoint: Setpoint, now_s: float) -> None:
        """Publish one setpoint, once."""
        self._client.publish(self._message(self._motion(setpoint), now_s))

    def keepalive(self, fresh: bool, now_s: float) -> None:
        """ROS robots know no heartbeat of ours."""

    def enable_sequence(self) -> Steps:
        """Command standstill and wait until the odometry can be trusted.

        Raises:
            BridgeError: if it cannot be within the profile's time.
        """
        self._odometer.forgive()
        self._stand()
        yield self._profile.period_s
        end_s = time.monotonic() + self._profile.enable_timeout_s
        while fault := self._fault(time.monotonic()):
            if time.monotonic() >= end_s:
                raise BridgeError(f"not enabled within {self._profile.enable_timeout_s:g} s: {fault}")
            yield self._profile.period_s
        self._enabled = True

    def stop_sequence(self) -> Steps:
        """Command standstill several times; whoever takes the robot meanwhile keeps it."""
        self._enabled = False
        for _ in range(self._profile.zeros):
            if self._taken():
                return
            self._stand()
            yield self._profile.period_s

    def _find(self) -> Graph:
        graph = discover(self._client, self._profile, OPENING_S)
        if found := missing(graph, self._profile):
            raise BridgeError(lost(found, graph, self._profile, self._client.where))
        return graph

    def _await(self, settled: Callable[[], bool], longest_s: float) -> None:
        end_s = time.monotonic() + longest_s
        while not settled() and (wait_s := end_s - time.monotonic()) > 0.0:
            select.select(self.filenos(), (), (), wait_s)
            self.receive(time.monotonic())

    def _heard(self) -> bool:
        return self.state() is not None and self._sight is not None and self._sight.listeners > 0

    def _silence(self) -> str:
        if self.state() is None:
            return self._odometer.fault(-math.inf) + f" on {self._profile.odometry}"
        return f"no subscriber of {self._profile.command} takes our messages: its type or QoS differs,"

    def _take(self, item: Item, now_s: float) -> None:
        if isinstance(item, Odometry):
            self._odometer.take(item)
        elif isinstance(item, Sight):
            self._sight = item
        elif isinstance(item, Pressed):
            self.emergency_stop.take(item.pressed, now_s)
        elif isinstance(item, Taken):
            self._operator = f"an operator commands the robot on {item.topic}"
        else:
            self._trouble = item.text

    def _taken(self) -> str:
        if self.emergency_stop.pressed:
            return f"the emergency stop is pressed ({self._profile.emergency_stop})"
        rivals = self._sight.rivals if self._sight else ()
        return self._operator or (rivals_said(rivals, self._profile.command) if rivals else "")

    def _fault(self, now_s: float) -> str:
        if self._sight and self._sight.odometers > 1:
            return (
                f"{self._sight.odometers} nodes publish {self._profile.odometry}: one robot has one odometry"
            )
        return self.emergency_stop.fault(now_s) or self._odometer.fault(now_s)

    def _motion(self, setpoint: Setpoint) -> BaseMotion:
        state = self._odometer.state
        if state is None:
            raise BridgeError(f"no odometry on {self._profile.odometry}")
        base, turn = self._profile.base, setpoint.yaw_rate_rad_s
        return motion_for(setpoint.velocity_m_s, state.heading_rad, base, turn)

    def _message(self, motion: BaseMotion, now_s: float) -> object:
        return self._client.compose(motion, self._odometer.robot_time_s(now_s))

    def _stand(self) -> None:
        self._client.publish(self._message(STANDSTILL, time.monotonic()))


def make_link(spec: GuardSpec) -> RosLink:
    """Build the link that a guard's specification describes; nothing of ROS is loaded yet.

    Raises:
        ConfigError: if the profile is wrong.
    """
    return RosLink(*make_parts(spec))


def make_parts(spec: GuardSpec) -> tuple[RosProfile, Client, Inbox[Item], Odometer]:
    """Build what the link is made of: profile, a node not yet connected, its inbox, an odometer."""
    options = msgspec.json.decode(spec.options, type=RosOptions)
    profile = load_profile(Path(options.profile)).under(options.namespace)
    if options.turns:
        profile = replace(profile, base=turning(profile.base))
    inbox: Inbox[Item] = Inbox()
    module = importlib.import_module(f"firmware_bridge.ros.ros{options.ros}")
    folders = options.python_path or profile.python_path
    client: Client = module.make_client(profile, options.namespace, spec.robot_id, folders, inbox.put)
    return profile, client, inbox, Odometer(spec.robot_id, profile, options.namespace, options.origin)
