"""The firmware of harness, benchmarks and tests, on a simulated clock: modes, timeout, faults, records."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as common

from firmware_bridge.can.frame import Frame
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.sil.firmware.agilex import BY_OPERATOR, EMERGENCY_STOP, AgilexChassis
from firmware_bridge.sil.firmware.autopilot import STATION_TIMEOUT_S, Autopilot
from firmware_bridge.sil.firmware.firmware import REST
from firmware_bridge.sil.firmware.intervals import STREAM_PERIOD_S
from firmware_bridge.sil.firmware.record import NodeRecorder, Pace
from firmware_bridge.sil.firmware.world import BaseState

STATE = BaseState((2.0, 1.0), 0.5, 0.25, -0.1)
HALF = Frame(0x111, struct.pack(">hhhh", 500, 200, 0, 0))
MINE, RELEASED, LOCKED = (
    Frame(0x421, b"\1" + bytes(7)),
    Frame(0x131, bytes(8)),
    Frame(0x131, b"\1" + bytes(7)),
)
MOTION_STATE, SYSTEM_STATE = 0x221, 0x211


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def chassis(clock):
    return AgilexChassis(clock)


@pytest.fixture
def rover(clock):
    return Autopilot(PROFILES["ardupilot_rover"], clock)


def enabled(chassis):
    for frame in (MINE, RELEASED):
        chassis.hear(frame, chassis.clock())


def say(rover, message, arrival_s=None):
    """What a vehicle answers, as names of messages."""
    packer = common.MAVLink(None, srcSystem=255, srcComponent=190)
    answers = rover.hear(bytes(message.pack(packer)), rover.clock() if arrival_s is None else arrival_s)
    return names(answers)


def names(frames):
    return [common.MAVLink(None).decode(bytearray(frame)).get_type() for frame in frames]


def command(number, *parameters):
    return common.MAVLink_command_long_message(1, 1, number, 0, *parameters, *[0.0] * (7 - len(parameters)))


def setpoint(forward=0.5, yaw_rate=-0.2):
    fields = (0, 1, 1, 8, 0x5C7, 0, 0, 0, forward, 0, 0, 0, 0, 0, 0, yaw_rate)
    return common.MAVLink_set_position_target_local_ned_message(*fields)


def engage(rover):
    say(rover, command(common.MAV_CMD_DO_SET_MODE, 1, 15))
    say(rover, command(common.MAV_CMD_COMPONENT_ARM_DISARM, 1))


class TestChassis:
    def test_it_obeys_once_it_is_handed_over_and_released(self, chassis, clock):
        for frame in (HALF, MINE, HALF):
            chassis.hear(frame, clock())
            assert chassis.motion(clock()) == REST
        chassis.hear(RELEASED, clock())
        chassis.hear(HALF, clock())
        assert chassis.motion(clock()) == BaseMotion(0.5, 0.0, 0.2)
        chassis.hear(LOCKED, clock())
        assert chassis.motion(clock()) == REST

    def test_it_rests_while_its_emergency_stop_is_pressed_and_says_so(self, chassis, clock):
        enabled(chassis)
        chassis.hear(HALF, clock())
        chassis.pressed = True
        assert chassis.motion(clock()) == REST
        assert chassis.report(STATE)[0].data[0] == EMERGENCY_STOP
        chassis.pressed, clock.now_s = False, clock.now_s + 0.1
        assert chassis.report(STATE)[0].data[0] == 0

    def test_it_moves_sideways_where_it_is_told_to(self, chassis, clock):
        enabled(chassis)
        chassis.hear(Frame(0x111, struct.pack(">hhhh", 100, -300, 250, 0)), clock())
        assert chassis.motion(clock()) == BaseMotion(0.1, 0.25, -0.3)
        chassis.report(STATE)
        (told,) = chassis.report(STATE._replace(lateral_m_s=0.25))
        assert told.data[4:6] == struct.pack(">h", 250)

    def test_an_operator_keeps_it(self, chassis, clock):
        enabled(chassis)
        chassis.control_mode = BY_OPERATOR
        for frame in (MINE, HALF):
            chassis.hear(frame, clock())
        assert (chassis.control_mode, chassis.motion(clock())) == (BY_OPERATOR, REST)

    def test_it_stops_by_itself_after_its_timeout_and_counts_it_once(self, chassis, clock):
        enabled(chassis)
        chassis.hear(HALF, arrival_s=100.0)
        assert chassis.motion(100.0 + chassis.timeout_s) == BaseMotion(0.5, 0.0, 0.2)
        for later_s in (1e-3, 1.0):
            assert chassis.motion(100.0 + chassis.timeout_s + later_s) == REST
        assert (chassis.timeouts, chassis.timed_out_s) == (1, 100.0 + chassis.timeout_s + 1e-3)

    def test_it_tells_motion_always_and_modes_at_intervals_and_changes(self, chassis, clock):
        def told():
            return [frame.frame_id for frame in chassis.report(STATE)]

        assert told() == [SYSTEM_STATE, MOTION_STATE]
        assert told() == [MOTION_STATE]
        chassis.hear(MINE, clock())
        assert told() == [SYSTEM_STATE, MOTION_STATE]
        assert chassis.report(STATE)[0].data[:4] == struct.pack(">hh", 250, -100)

    def test_faults(self, chassis):
        chassis.report(STATE)
        whole = chassis.report(STATE)
        for fault, told in (("silent", []), ("stale", [])):
            setattr(chassis, fault, True)
            assert chassis.report(STATE) == told
            setattr(chassis, fault, False)
        chassis.corrupt = True
        (cut,) = chassis.report(STATE)
        assert len(cut.data) < len(whole[0].data)


class TestAutopilot:
    def test_it_obeys_armed_in_its_command_mode(self, rover, clock):
        say(rover, setpoint())
        assert rover.motion(clock()) == REST
        engage(rover)
        say(rover, setpoint())
        assert rover.motion(clock()) == BaseMotion(0.5, 0.0, pytest.approx(0.2))
        say(rover, command(common.MAV_CMD_DO_SET_MODE, 1, 4))
        assert rover.motion(clock()) == REST

    def test_a_refused_command_is_acknowledged_explained_and_ignored(self, rover):
        rover.refuses = {common.MAV_CMD_COMPONENT_ARM_DISARM}
        assert say(rover, command(common.MAV_CMD_COMPONENT_ARM_DISARM, 1)) == ["COMMAND_ACK", "STATUSTEXT"]
        assert not rover.armed

    def test_an_interval_faster_than_its_scheduler_grants_is_denied(self, rover):
        """ArduPilot 4.6: 80 % of SCHED_LOOP_RATE, which Rover has at 50."""
        rover.loop_rate_hz = 50.0
        for asked_us, result in ((10_000, 2), (24_999, 2), (25_000, 0), (-1, 0)):
            packer = common.MAVLink(None, srcSystem=255, srcComponent=190)
            wish = command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 32, asked_us)
            (answer,) = rover.hear(bytes(wish.pack(packer)), rover.clock())
            assert common.MAVLink(None).decode(bytearray(answer)).result == result
        assert rover.intervals.get_us(32) == -1

    def test_a_station_on_the_same_link_changes_all_streams(self, rover):
        say(rover, command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 10_000))
        assert rover.intervals.get_us(32) == 10_000
        say(rover, common.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
        assert rover.intervals.get_us(32) == 250_000

    def test_it_tells_intervals_and_single_messages(self, rover):
        assert say(rover, command(common.MAV_CMD_GET_MESSAGE_INTERVAL, 32)) == [
            "MESSAGE_INTERVAL",
            "COMMAND_ACK",
        ]
        for _ in range(2):
            rover.report(STATE)
        assert names(rover.report(STATE)) == []
        say(rover, command(common.MAV_CMD_REQUEST_MESSAGE, 193))
        say(rover, command(common.MAV_CMD_REQUEST_MESSAGE, 12345))
        assert names(rover.report(STATE)) == ["HEARTBEAT", "EKF_STATUS_REPORT"]

    def test_a_failsafe_changes_its_mode_where_the_guards_heartbeats_end(self, rover, clock):
        rover.station_failsafe = True
        say(rover, common.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        engage(rover)
        for later_s, mode in ((STATION_TIMEOUT_S, 15), (STATION_TIMEOUT_S + 0.1, 4)):
            clock.now_s = 100.0 + later_s
            rover.report(STATE)
            assert rover.mode == mode
        assert rover.motion(clock()) == REST

    def test_streams_come_at_the_intervals_that_were_asked_for(self, rover, clock):
        say(rover, command(common.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 10_000))
        told = []
        for step in range(100):
            clock.now_s = 100.0 + 0.01 * step
            told += names(rover.report(STATE))
        assert told.count("LOCAL_POSITION_NED") == 100
        usual = round(1.0 / STREAM_PERIOD_S)
        assert usual <= told.count("HEARTBEAT") == told.count("ATTITUDE") <= usual + 1

    def test_it_tells_those_parameters_that_it_has(self, rover):
        def asks(name):
            return say(rover, common.MAVLink_param_request_read_message(1, 1, name, -1))

        assert asks(b"GUID_TIMEOUT") == ["PARAM_VALUE"]
        assert asks(b"WP_SPEED") == []

    def test_faults(self, rover):
        rover.silent = True
        assert rover.report(STATE) == []
        assert say(rover, common.MAVLink_timesync_message(0, 1)) == []
        rover.silent, rover.not_finite = False, True
        clock_moves_on = rover.clock.now_s + 1.0
        rover.clock.now_s = clock_moves_on
        told = [common.MAVLink(None).decode(bytearray(frame)) for frame in rover.report(STATE)]
        (position,) = (message for message in told if message.get_type() == "LOCAL_POSITION_NED")
        assert math.isnan(position.x) and math.isnan(position.y)
        rover.corrupt = True
        rover.clock.now_s += 1.0
        with pytest.raises(common.MAVError):
            names(rover.report(STATE))

    def test_noise_is_passed_over(self, rover):
        assert rover.hear(b"\xfd noise", 0.0) == []


def test_a_streams_poses_are_recorded_in_the_place_of_the_firmwares(chassis):
    recorder = NodeRecorder(7, chassis, Pace(50.0, 120.0, 1.0), streamed=True)
    chassis.report(STATE)
    recorder.take_pose(3.0, 0.25)
    record = recorder.record()
    assert (record.pose_s, record.pose_x_m) == ([3.0], [0.25])


def test_every_command_is_recorded_with_its_arrival_obeyed_or_not(chassis):
    recorder = NodeRecorder(7, chassis, Pace(50.0, 50.0, 1.0))
    chassis.hear(HALF, arrival_s=1.0)
    enabled(chassis)
    chassis.hear(HALF, arrival_s=2.0)
    chassis.report(STATE)
    record = recorder.record()
    assert (record.robot_id, record.command_s, record.forward_m_s) == (7, [1.0, 2.0], [0.5, 0.5])
    assert (record.yaw_rad_s, record.pose_s, record.timeouts) == ([0.2, 0.2], [100.0], 0)
    assert chassis.obeyed == 1
