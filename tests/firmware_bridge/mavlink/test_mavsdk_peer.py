"""The whole way, runtime side -> guard process -> UDP, to an autopilot made of the MAVSDK library."""

import importlib.util
import json
import subprocess
import sys
import threading
import time

import msgspec
import pytest
from bundles import MANIFEST
from paths import SUPPORT
from ports import free_port
from waiting import HANG_S, until

from edge_runtime.errors import BridgeError
from edge_runtime.messages import Command
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.spec import GuardFlags
from firmware_bridge.guard.wire import Phase
from firmware_bridge.mavlink.bridge import MavlinkFlags, make_spec

PERIOD_S = 0.05

pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(
        importlib.util.find_spec("mavsdk") is None,
        reason="the mavsdk package is not installed: pip install mavsdk",
    ),
]


class Peer:
    """The autopilot's process and what it has told."""

    def __init__(self):
        _, self.port = free_port()
        script = SUPPORT / "peers" / "mavsdk_autopilot.py"
        self.process = subprocess.Popen(
            [sys.executable, str(script), str(self.port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.events = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            if line.startswith("{"):
                self.events.append(json.loads(line))

    def order(self, text):
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def of(self, kind):
        return [event for event in self.events if event["event"] == kind]

    def close(self):
        self.process.kill()
        self.process.wait()
        self._reader.join()
        self.process.stdin.close()
        self.process.stdout.close()


@pytest.fixture
def peer():
    peer = Peer()
    until(lambda: peer.of("up"), by=peer.process)
    yield peer
    peer.close()


def bridge_to(peer, arm=True):
    # No deadline passes: these tests are about protocols, and the machine may be busy.
    guard = GuardFlags(arm=arm)
    options = MavlinkFlags(f"udpout:127.0.0.1:{peer.port}", "px4", guard)
    spec = make_spec(7, MANIFEST, options, 1.0 / PERIOD_S)
    return GuardedBridge(msgspec.structs.replace(spec, deadline_s=HANG_S))


class Runtime:
    """Commands a constant action at the control rate."""

    def __init__(self, bridge):
        self.bridge = bridge
        self.sequence = 0

    def command(self):
        self.sequence += 1
        self.bridge.write(Command(7, self.sequence, time.monotonic(), (0.5, 0.0), (0.01, 0.0)))
        self.bridge.read()

    def command_until(self, settled):
        until(lambda: self.command() or settled(), pause_s=PERIOD_S)


def moving(peer):
    """The setpoints that it has told of which ask for a motion."""
    return [event for event in peer.of("setpoint") if event["vy"] != 0.0]


def test_an_autopilot_is_engaged_driven_and_stopped(peer):
    with bridge_to(peer) as bridge:
        assert not peer.of("heartbeat"), "a heartbeat before the first command"
        runtime = Runtime(bridge)
        runtime.command_until(lambda: bridge.counts.forwarded >= 40)
        state = bridge.read()
        assert (state.robot_id, state.position_m) == (7, (4.0, 3.0))
        assert state.velocity_m_s == pytest.approx((0.0, 0.25))
        assert abs(time.monotonic() - state.stamp_s) < HANG_S, "the stamp is not of our clock"
        bridge.stop("enough")
        until(lambda: [event["mode"] for event in peer.of("mode")] == ["OFFBOARD", "HOLD"])
        heartbeats = len(peer.of("heartbeat"))  # what was sent before HOLD has come
        time.sleep(1.5)
    assert heartbeats == len(peer.of("heartbeat")) > 0, "a heartbeat after the stop"
    assert [event["armed"] for event in peer.of("arm")] == [True]
    assert len(moving(peer)) == bridge.counts.forwarded
    assert all(event["type_mask"] == 0xDC7 and event["coordinate_frame"] == 1 for event in moving(peer))
    speeds = [event["vy"] for event in moving(peer)]
    assert speeds == sorted(speeds)
    assert max(speeds) <= 1.0
    assert peer.of("setpoint")[-1]["vy"] == 0.0
    armed_s = peer.of("arm")[0]["at_s"]
    assert all(event["at_s"] > armed_s for event in moving(peer))


def test_an_operator_keeps_what_he_takes(peer):
    with bridge_to(peer) as bridge:
        runtime = Runtime(bridge)
        runtime.command_until(lambda: bridge.counts.forwarded >= 5)
        peer.order("mode MANUAL")
        with pytest.raises(BridgeError, match="operator or failsafe"):
            runtime.command_until(lambda: False)
        assert bridge.phase is Phase.STOPPED
        until(lambda: bridge.read() and len(moving(peer)) == bridge.counts.forwarded)  # all has come
        seen = len(peer.of("mode")) + len(peer.of("arm")) + len(peer.of("setpoint"))
        time.sleep(0.5)
    assert seen == len(peer.of("mode")) + len(peer.of("arm")) + len(peer.of("setpoint"))
    assert [event["mode"] for event in peer.of("mode")] == ["OFFBOARD"]


def test_without_arm_nothing_is_commanded(peer):
    with bridge_to(peer, arm=False) as bridge:
        runtime = Runtime(bridge)
        runtime.command_until(lambda: bridge.counts.withheld >= 20)
    assert not peer.of("mode")
    assert not peer.of("arm")
    assert not peer.of("setpoint")
