"""The harness's and the benchmarks' robot behind genuine ROS: it obeys its guard, and stops without one."""

import contextlib
import math
import os
import signal
import threading

import pytest
from msgspec.structs import replace
from ros_peers import DEBIAN, SPEED_M_S, domain, drive, needs_ros1, needs_ros2, site_packages
from waiting import HANG_S, until

from edge_runtime.errors import BridgeError
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.ros.profile import profile_path
from firmware_bridge.sil.firmware.ros_base import RosBase
from firmware_bridge.sil.firmware.ros_node import Stop, Twisted
from firmware_bridge.sil.firmware.world import BaseState
from firmware_bridge.sil.scenario.ros_place import free_ros

faults = pytest.importorskip("benchmarks.faults.ros_robot", reason="benchmarks are a workstation's")
REST = BaseState((0.0, 0.0), 0.0, 0.0, 0.0)


@pytest.fixture(params=[pytest.param(1, marks=needs_ros1), pytest.param(2, marks=needs_ros2)])
def kind(request, monkeypatch, tmp_path):
    """A robot's class, whose profile is a patient one."""
    if request.param == 1:
        base, folder, name = faults.Ros1Robot, DEBIAN, "husky_noetic"
    else:
        domain(monkeypatch)
        base, folder, name = faults.Ros2Robot, str(site_packages("kilted")), "clearpath_jazzy"
    patient = tmp_path / "patient.toml"
    patient.write_text("stale_s = 5.0\n" + profile_path(name).read_text())
    for name in (*free_ros(1, tmp_path).environment, *free_ros(2, tmp_path).environment):
        monkeypatch.setenv(name, os.environ.get(name, ""))  # put back afterwards
    return type("Patient", (base,), {"python_path": (folder,), "profile": str(patient)})


@contextlib.contextmanager
def served(robot):
    """It acts in a thread."""
    ending = threading.Event()
    thread = threading.Thread(target=lambda: robot.serve(HANG_S, ending.is_set))
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


@pytest.mark.integration
def test_it_drives_as_its_guard_says_and_stops_by_itself_when_the_guard_was_killed(kind):
    with (
        kind() as robot,
        served(robot),
        contextlib.suppress(BridgeError),
        GuardedBridge(replace(robot.spec(), deadline_s=HANG_S)) as bridge,
    ):
        drive(bridge, lambda: robot.cruises() and bridge.read().position_m[0] > 0.5)
        assert bridge.read().velocity_m_s[0] == pytest.approx(SPEED_M_S, rel=0.1)
        os.kill(bridge.guard_pid, signal.SIGKILL)
        until(lambda: robot.firmware.timeouts and robot.stands())


def test_a_base_follows_its_newest_command_until_its_timeout():
    now = 5.0
    base = RosBase(0.25, lambda: now)
    heard = []

    def told():
        return [getattr(packet, "state", packet) for packet in base.report(REST)]

    base.on_command = heard.append
    assert base.hear(Twisted(0.5, 0.2, 0.1, now), now) == []
    assert base.motion(now + 0.2) == BaseMotion(0.5, 0.2, 0.1)
    base.pressed = True
    assert base.motion(now + 0.2) == BaseMotion()
    assert told() == [Stop(True), REST]
    base.pressed = False
    assert base.motion(now + 0.3) == BaseMotion()
    assert (base.timeouts, base.timed_out_s) == (1, now + 0.3)
    assert heard[0].motion == BaseMotion(0.5, 0.2, 0.1)
    assert told() == [REST]
    base.stale = True
    assert told() == []
    base.stale, base.not_finite = False, True
    assert math.isnan(told()[0].forward_m_s)
    base.not_finite, base.corrupt = False, True
    assert math.isnan(told()[0].forward_m_s)
    assert base.hear(Stop(True), now) == []
