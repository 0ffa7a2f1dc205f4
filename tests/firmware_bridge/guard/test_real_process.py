"""The guard as a real process on a real (multicast) bus: what the firmware sees when its peers die."""

import contextlib
import itertools
import operator
import os
import signal
import time

import pytest
from can_peers import (
    Chassis,
    guard_spec,
    multicast_address,
    patient_profile,
    patient_spec,
    start_runtime,
)
from paths import ROOT
from waiting import HANG_S, until

from edge_runtime.errors import BridgeError
from edge_runtime.messages import Command
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.wire import Phase

ZERO = bytes(8)
HALF = bytes.fromhex("01f4000000000000")  # 500 mm/s


SOON_S = 0.5
"""The guard's deadline where a test lets it pass."""


@pytest.fixture
def address():
    return multicast_address()


def stop_of(frames):
    """The frames after the last full-speed command."""
    last = max(index for index, frame in enumerate(frames) if frame == (0x111, HALF))
    return frames[last + 1 :]


def assert_ramped_stop(frames):
    """Speeds fall to zero, three zeros, brake, standby: nothing else, and nothing after."""
    stop = stop_of(frames)
    speeds = [int.from_bytes(data[:2], "big") for frame_id, data in stop if frame_id == 0x111]
    assert speeds == sorted(speeds, reverse=True)
    assert 0 < speeds[0] < 500
    assert speeds[-3:] == [0, 0, 0]
    assert stop[-2:] == [(0x131, b"\x01" + bytes(7)), (0x421, ZERO)]


def drives(chassis):
    return lambda: chassis.data(0x111).count(HALF) >= 5


def stands_by(chassis):
    return lambda: chassis.ids()[-1:] == [0x421] and chassis.frames[-1][1] == ZERO


def test_a_complaint_arrives_while_the_robot_drives_on(address):
    with Chassis(address) as chassis, GuardedBridge(patient_spec(address)) as bridge:
        numbers = itertools.count()

        def command():
            bridge.write(Command(3, next(numbers), time.monotonic(), (0.0, 0.0), (0.5, 0.0)))
            return bridge.complaints

        until(lambda: command() or drives(chassis)(), 0.02)
        chassis.errors = {"BatteryLow": 1}
        until(command, 0.02)
        assert bridge.complaints == ("the firmware warns (SystemState.BatteryLow = 1)",)
        assert bridge.phase is Phase.DRIVING


def test_enables_before_it_drives(address):
    with Chassis(address) as chassis:
        runtime, _ = start_runtime(patient_spec(address))
        chassis.wait(drives(chassis), runtime)
        runtime.kill()
        chassis.wait(stands_by(chassis))
        runtime.wait()
    first = chassis.ids().index(0x421)
    assert chassis.ids()[: first + 2] == [0x111, 0x441, 0x421, 0x131]
    assert chassis.frames[0][1] == ZERO
    assert chassis.frames[first][1] == b"\x01" + bytes(7)


def start_driving(chassis, address):
    """Start a runtime whose deadline can pass; where it did so on a busy machine, anew with a longer one."""
    deadlines_s = itertools.accumulate(itertools.repeat(2.0), operator.mul, initial=SOON_S)

    def started():
        chassis.frames.clear()
        runtime, _ = start_runtime(patient_spec(address, deadline_s=next(deadlines_s)))
        chassis.wait(lambda: drives(chassis)() or runtime.poll() is not None)
        if drives(chassis)():
            return runtime
        chassis.settle()
        chassis.wait(lambda: not chassis.frames or stands_by(chassis)())
        return None

    return until(started)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_dead_runtime_stops_the_robot(address, number):
    with Chassis(address) as chassis:
        runtime = start_driving(chassis, address)
        runtime.send_signal(number)
        chassis.wait(stands_by(chassis))
        frames = list(chassis.frames)
        time.sleep(0.1)
        chassis.settle()
        assert chassis.frames == frames
        runtime.kill()
        runtime.wait()
    assert_ramped_stop(frames)


def test_a_thawed_runtime_does_not_drive_again(address):
    with Chassis(address) as chassis:
        runtime = start_driving(chassis, address)
        runtime.send_signal(signal.SIGSTOP)
        chassis.wait(stands_by(chassis))
        frames = list(chassis.frames)
        runtime.send_signal(signal.SIGCONT)
        assert runtime.wait(HANG_S) == 1
        chassis.settle()
    assert chassis.frames == frames


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_to_the_guard_stop_the_robot(address, number):
    with Chassis(address) as chassis:
        runtime, guard = start_runtime(patient_spec(address))
        chassis.wait(drives(chassis), runtime)
        os.kill(guard, number)
        chassis.wait(stands_by(chassis))
        assert runtime.wait(HANG_S) == 1
    assert_ramped_stop(chassis.frames)


def test_a_dead_guard_ends_the_commands_and_the_runtime(address):
    with Chassis(address) as chassis:
        runtime, guard = start_runtime(patient_spec(address))
        chassis.wait(drives(chassis), runtime)
        os.kill(guard, signal.SIGKILL)
        assert runtime.wait(HANG_S) == 1
        chassis.settle()
        frames = list(chassis.frames)
        time.sleep(0.1)
        chassis.settle()
        assert chassis.frames == frames
    assert chassis.frames[-1] == (0x111, HALF)


def command(sequence, velocity=(0.5, 0.0)):
    return Command(3, sequence, time.monotonic(), (0.0, 0.0), velocity)


def drive(bridge, chassis, condition, sequence=0):
    """Command 0.5 m/s until the condition holds; returns the number of the next command."""
    numbers = itertools.count(sequence)
    until(
        lambda: bridge.write(command(next(numbers))) or condition(),
        pause_s=0.02,
        tell=lambda: f"frames: {chassis.frames[-20:]}",
    )
    return next(numbers)


def test_leaving_the_bridge_stops_the_robot_and_reports_states(address):
    with Chassis(address) as chassis:
        with GuardedBridge(patient_spec(address)) as bridge:
            sequence = drive(bridge, chassis, drives(chassis))
            drive(bridge, chassis, lambda: bridge.read().velocity_m_s[0] == 0.5, sequence)
            state = bridge.read()
            assert bridge.phase is Phase.DRIVING
        chassis.wait(stands_by(chassis))
    assert state.robot_id == 3
    assert state.position_m[0] > 0.2  # the point ahead of the axle that this profile steers
    assert bridge.counts.forwarded
    assert_ramped_stop(chassis.frames)


def test_stop_is_final(address):
    with Chassis(address) as chassis, GuardedBridge(patient_spec(address)) as bridge:
        sequence = drive(bridge, chassis, drives(chassis))
        bridge.stop("enough")
        chassis.wait(stands_by(chassis))
        with pytest.raises(BridgeError, match="enough"):
            bridge.write(command(sequence))
        bridge.stop("again")


@pytest.mark.parametrize("velocity", [(float("nan"), 0.0), (float("inf"), 0.0), (1.51, 0.0)])
def test_a_bad_command_stops_the_robot(address, velocity):
    with Chassis(address) as chassis, GuardedBridge(patient_spec(address)) as bridge:
        sequence = drive(bridge, chassis, drives(chassis))
        with contextlib.suppress(BridgeError):  # a quick guard is heard before write returns
            bridge.write(command(sequence, velocity))
        chassis.wait(stands_by(chassis))
    assert_ramped_stop(chassis.frames)


@pytest.mark.parametrize("control_mode", [2, 3], ids=["at the serial port", "with the remote control"])
def test_an_operator_keeps_the_robot(address, control_mode):
    with Chassis(address) as chassis, GuardedBridge(patient_spec(address)) as bridge:
        drive(bridge, chassis, drives(chassis))
        chassis.control_mode = control_mode
        with pytest.raises(BridgeError, match="operator"):
            drive(bridge, chassis, lambda: False)
        chassis.settle()
        frames = list(chassis.frames)
    assert chassis.frames == frames
    assert chassis.frames[-1] == (0x111, HALF)


def test_stale_feedback_stops_and_enables_again_at_most_three_times(address):
    profile = patient_profile(stale_s=SOON_S, enable_timeout_s=2.0)
    with Chassis(address, control_mode=1) as chassis, GuardedBridge(patient_spec(address, profile)) as bridge:
        with pytest.raises(BridgeError, match=r"after 3 recoveries"):  # a busy machine's silence counts too
            sequence = drive(bridge, chassis, drives(chassis))
            chassis.silent = True
            drive(bridge, chassis, lambda: False, sequence)
        chassis.settle()
    assert chassis.data(0x421).count(b"\x01" + bytes(7)) == 4
    assert bridge.counts.recoveries == 3


def test_a_cleared_fault_drives_on(address):
    with Chassis(address) as chassis, GuardedBridge(patient_spec(address)) as bridge:
        sequence = drive(bridge, chassis, drives(chassis))
        chassis.vehicle_state = 2
        sequence = drive(bridge, chassis, lambda: bridge.phase is Phase.RECOVERING, sequence)
        chassis.vehicle_state = 0
        drive(bridge, chassis, lambda: bridge.phase is Phase.DRIVING, sequence)
        assert bridge.counts.recoveries == 1


def test_without_arm_only_an_enabled_robot_drives(address):
    with Chassis(address) as chassis, GuardedBridge(patient_spec(address, arm=False)) as bridge:
        sequence = drive(bridge, chassis, lambda: bridge.counts.withheld >= 10)
        chassis.settle()
        assert not chassis.frames
        chassis.control_mode = 1
        drive(bridge, chassis, drives(chassis), sequence)
    assert set(chassis.ids()) >= {0x111}
    assert (0x421, b"\x01" + bytes(7)) not in chassis.frames


def test_unknown_firmware_timeouts_refuse_to_start(address, tmp_path):
    source = ROOT / "firmware_bridge" / "profiles"
    (tmp_path / "agilex_v2.dbc").write_bytes((source / "agilex_v2.dbc").read_bytes())
    known, unknown = (source / "agilex_v2.toml").read_text(), tmp_path / "mine.toml"
    unknown.write_text(known.replace("firmware_timeout_s = 0.5", ""))
    with pytest.raises(BridgeError, match="unknown"), GuardedBridge(guard_spec(address, str(unknown))):
        pass
    allowed = guard_spec(address, str(unknown), allow_unsafe_firmware_timeout=True)
    with GuardedBridge(allowed) as bridge:
        assert bridge.phase is Phase.WATCHING


def test_a_bus_that_does_not_exist_is_one_line():
    with pytest.raises(BridgeError) as caught, GuardedBridge(guard_spec("can77")):
        pass
    assert "can77" in str(caught.value)
    assert "\n" not in str(caught.value)
