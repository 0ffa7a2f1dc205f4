"""Checks of a ROS robot before a run: who is there, what topics carry, what the robot says unasked."""

import contextlib
import select
import time
from collections.abc import Iterator
from functools import partial
from typing import Final

from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, ok, warn
from firmware_bridge.guard.diagnostics import firmware_timeout, stopping_distances
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.ros.bridge import RosFlags, make_spec
from firmware_bridge.ros.client import Client, Item, Pressed
from firmware_bridge.ros.inbox import Inbox
from firmware_bridge.ros.link import make_parts
from firmware_bridge.ros.odometry import Odometer, Odometry
from firmware_bridge.ros.opening import discover, expected_types, lost, missing
from firmware_bridge.ros.profile import RosProfile

LISTEN_S: Final = 3.0
"""For discovery, and once more for the robot to speak."""


def examine_link(mission: Mission, options: RosFlags) -> Iterator[Finding]:
    """Yield what is found; nothing is published, and no publisher of commands comes to be.

    Raises:
        ConfigError: at once, if profile, namespace, limits or rates do not fit.
    """
    return _findings(mission, make_spec(mission.robot_id, mission.bundle.manifest, options, mission.rate_hz))


def _findings(mission: Mission, spec: GuardSpec) -> Iterator[Finding]:
    profile, client, inbox, odometer = make_parts(spec)
    with contextlib.closing(inbox), contextlib.closing(client):
        yield (connected := examine("ROS", partial(connection, client)))
        if connected.verdict is Verdict.FAIL:
            return
        yield examine("topics", partial(topics, client, profile))
        yield examine("quality of service", partial(quality, client))
        heard = Heard(profile, client, inbox, odometer)
        yield examine("odometry", heard.odometry)
        yield examine("emergency stop", heard.emergency_stop)
        timeout_s, source = known_timeout(client, profile)
        unsafe = spec.allow_unsafe_firmware_timeout
        yield examine("firmware timeout", lambda: firmware_timeout(timeout_s, source, allow_unsafe=unsafe))
        yield examine("stopping", lambda: stopping_distances(mission, spec, timeout_s))


def connection(client: Client) -> Finding:
    """Whether ROS is installed and lets us in.

    Raises:
        BridgeError: if it does not.
    """
    client.connect()
    return ok(f"{client.where}, as {client.name}")


def topics(client: Client, profile: RosProfile) -> Finding:
    """Whether the robot is there, its topics carry what the profile says, and nobody else commands it.

    Raises:
        ConfigError, BridgeError: as `check_graph`.
    """
    graph = discover(client, profile, LISTEN_S)
    if found := missing(graph, profile):
        return fail(lost(found, graph, profile, client.where))
    seen = [f"{name} ({kind})" for name, kind in expected_types(profile).items() if graph.topic(name).types]
    return ok(", ".join(seen))


def quality(client: Client) -> Finding:
    """Whether messages pass between the robot's nodes and this one."""
    if unheard := client.unheard():
        return fail("; ".join(unheard), "change the quality of service of the robot's node")
    return ok("messages pass both ways")


def known_timeout(client: Client, profile: RosProfile) -> tuple[float | None, str]:
    """Return the controller's own timeout, None where unknown, and who told it."""
    if profile.timeout_parameter is None:
        stated = profile.firmware_timeout_s is not None
        return profile.firmware_timeout_s, "says the profile" if stated else "nobody has told it"
    return client.parameter(profile.timeout_parameter), f"as {profile.timeout_parameter} has it"


class Heard:
    """What the robot says by itself within a bounded time."""

    def __init__(self, profile: RosProfile, client: Client, inbox: Inbox[Item], odometer: Odometer) -> None:
        self._profile, self._client, self._inbox, self._odometer = profile, client, inbox, odometer
        self._pressed: bool | None = None

    def odometry(self) -> Finding:
        """Whether it comes, is fresh and makes sense.

        Raises:
            BridgeError: if ROS fails, or something floods a topic.
        """
        self._client.listen()
        end_s = time.monotonic() + LISTEN_S
        while not self._complete() and (wait_s := end_s - time.monotonic()) > 0.0:
            select.select((self._inbox,), (), (), wait_s)
            for item in self._inbox.take():
                self._take(item)
        if fault := self._odometer.fault(time.monotonic()):
            return fail(fault, f"see what publishes {self._profile.odometry}")
        if self._odometer.warning:
            return warn(self._odometer.warning, "set the clocks by chrony, unless a simulator keeps its own")
        return ok(f"{self._profile.odometry} is fresh")

    def emergency_stop(self) -> Finding:
        """Whether it is released; looked at after the odometry."""
        topic = self._profile.emergency_stop
        if topic is None:
            return warn("the profile names no topic of it", "the guard cannot see it pressed")
        if self._pressed is None:
            return warn(
                f"nobody has said anything on {topic}", "the guard sees it pressed once somebody does"
            )
        return fail(f"pressed ({topic})", "release it") if self._pressed else ok(f"released ({topic})")

    def _complete(self) -> bool:
        silent = self._profile.emergency_stop is not None and self._pressed is None
        return not silent and not self._odometer.fault(time.monotonic())

    def _take(self, item: Item) -> None:
        if isinstance(item, Odometry):
            self._odometer.take(item)
        elif isinstance(item, Pressed):
            self._pressed = item.pressed
