import itertools

import pytest
from mavlink_peers import ScriptedAutopilot, Ticks, vehicle_frame
from pymavlink.dialects.v20 import common

import firmware_bridge.mavlink.channel as mavlink_channel
from edge_runtime.errors import BridgeError, ConfigError
from edge_runtime.motion.dynamics import Dynamics
from firmware_bridge.guard.link import Condition, Setpoint, SetpointLimits
from firmware_bridge.mavlink.link import MavlinkLink
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.signing import clock_ticks

SET_MODE, ARM = 176, 400
DYNAMICS = Dynamics(mass_kg=1.0, drag=0.25, dt_s=0.1).at_period(0.02)
LIMITS = SetpointLimits(speed_m_s=1.0, action=1.0)


@pytest.fixture
def clock():
    return Ticks()


@pytest.fixture
def connect(clock, monkeypatch):
    """Open a link to a scripted autopilot."""

    def connect(profile="px4", **traits):
        autopilot = ScriptedAutopilot(profile, clock)
        for name, value in traits.items():
            setattr(autopilot, name, value)
        monkeypatch.setattr(mavlink_channel, "open_transport", lambda _: autopilot)
        options = MavlinkOptions(profile, "udpin:h:1", DYNAMICS, point_ahead_m=0.5)
        link = MavlinkLink(options, 4, LIMITS, clock)
        link.open()
        return link, autopilot

    return connect


def walk(link, steps, clock, during=lambda: None):
    """Run a sequence as the guard does: feedback between the steps."""
    for delay_s in steps:
        clock.now_s += delay_s
        during()
        link.receive(clock.now_s)


def drive(link, clock):
    walk(link, link.enable_sequence(), clock)
    assert link.health(clock.now_s).condition is Condition.READY


def command(action=(0.5, 0.0), velocity=(0.01, 0.0)):
    return Setpoint(1, 0.0, action, velocity)


@pytest.mark.parametrize("profile", PROFILES)
class TestEveryProfile:
    def test_opening_learns_timeout_and_state_and_changes_nothing(self, connect, clock, profile):
        link, autopilot = connect(profile)
        assert link.firmware_timeout_s == pytest.approx(0.5)
        state = link.state()
        north_m = 1.5 if profile == "ardupilot_rover" else 1.0  # A rover's point ahead is what is reported.
        assert (state.robot_id, state.position_m) == (4, (2.0, pytest.approx(north_m)))
        assert state.stamp_s == pytest.approx(clock.now_s, abs=0.1)
        assert not autopilot.commands(SET_MODE)
        assert not autopilot.commands(ARM)
        assert not autopilot.setpoints()

    def test_enabling_is_ready_when_heartbeats_say_so(self, connect, clock, profile):
        link, autopilot = connect(profile)
        assert link.health(clock.now_s).condition is Condition.WAITING
        drive(link, clock)
        assert autopilot.armed
        assert autopilot.mode == PROFILES[profile].command_mode.reported
        moving = [m for m in autopilot.setpoints() if m.vx or m.vy or m.afx or m.afy or m.yaw_rate]
        assert not moving

    def test_the_mode_comes_before_the_arming(self, connect, clock, profile):
        link, autopilot = connect(profile)
        drive(link, clock)
        order = [m.command for m in autopilot.heard if getattr(m, "command", 0) in (SET_MODE, ARM)]
        assert order == [SET_MODE, ARM]

    def test_one_command_is_one_setpoint(self, connect, clock, profile):
        link, autopilot = connect(profile)
        drive(link, clock)
        before = len(autopilot.setpoints())
        for _ in range(5):
            link.send(command(action=(0.0, 0.0), velocity=(1e-3, 0.0)), clock.now_s)
        assert len(autopilot.setpoints()) == before + 5
        assert link.dropped() == 0

    def test_stopping_sends_zero_first_and_then_the_stop_mode(self, connect, clock, profile):
        link, autopilot = connect(profile)
        drive(link, clock)
        link.send(command(action=(0.0, 0.0), velocity=(1e-3, 0.0)), clock.now_s)
        autopilot.heard.clear()
        walk(link, link.stop_sequence(), clock)
        zero, mode = autopilot.heard[0], autopilot.heard[-1]
        assert (zero.vx, zero.vy, zero.yaw_rate) == (0.0, 0.0, 0.0)
        assert not zero.type_mask & 0x38
        assert mode.command == SET_MODE
        assert autopilot.mode == PROFILES[profile].stop_mode.reported
        assert link.health(clock.now_s).condition is Condition.WAITING

    def test_acknowledgements_do_not_count_as_arming(self, connect, clock, profile):
        link, _ = connect(profile, refuses={ARM})
        with pytest.raises(BridgeError, match="did not arm: Arm: compass not calibrated"):
            walk(link, link.enable_sequence(), clock)

    def test_acknowledgements_do_not_count_as_a_mode(self, connect, clock, profile):
        link, autopilot = connect(profile, refuses={SET_MODE})
        with pytest.raises(BridgeError, match=PROFILES[profile].command_mode.name):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(ARM)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_rehearsal_puts_nothing_on_the_wire_and_changes_no_setpoint(connect, clock, profile):
    sent = []
    for rehearsals in (0, 3):
        link, autopilot = connect(profile)
        drive(link, clock)
        before = len(autopilot.setpoints())
        for _ in range(rehearsals):
            link.rehearse(command(), clock.now_s)
        assert len(autopilot.setpoints()) == before
        link.send(command(), clock.now_s)
        message = autopilot.setpoints()[-1]
        sent.append([getattr(message, name) for name in ("vx", "vy", "afx", "afy", "yaw_rate")])
    assert sent[0] == sent[1]


class TestPx4:
    def test_setpoints_stream_for_a_second_before_offboard_is_asked_for(self, connect, clock):
        link, autopilot = connect("px4")
        times = []
        walk(link, link.enable_sequence(), clock, lambda: times.append((clock.now_s, len(autopilot.heard))))
        asked = next(i for i, m in enumerate(autopilot.heard) if getattr(m, "command", 0) == SET_MODE)
        streamed = [m.time_boot_ms for m in autopilot.heard[:asked] if m in autopilot.setpoints()]
        assert streamed[-1] - streamed[0] >= 1000
        assert max(b - a for a, b in itertools.pairwise(streamed)) < 500


class TestOverride:
    @pytest.mark.parametrize("hand", ["mode", "disarm"])
    def test_an_operator_keeps_the_robot(self, connect, clock, hand):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        if hand == "mode":
            autopilot.mode = 0
        else:
            autopilot.armed = False
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.OVERRIDE
        autopilot.heard.clear()
        walk(link, link.stop_sequence(), clock)
        assert autopilot.heard == []
        with pytest.raises(BridgeError, match="operator"):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(ARM)
        assert not autopilot.commands(SET_MODE)

    def test_handing_it_back_does_not_count(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot.mode = 0
        link.receive(clock.now_s)
        autopilot.mode = 15
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.OVERRIDE

    def test_a_robot_enabled_by_hand_is_ready_without_our_doing(self, connect, clock):
        link, autopilot = connect("ardupilot_rover", mode=15, armed=True)
        assert link.health(clock.now_s).condition is Condition.READY
        link.send(command((0.0, 0.0), (1e-3, 0.0)), clock.now_s)
        autopilot.mode = 0
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.OVERRIDE

    def test_a_robot_that_was_never_taken_is_not_stopped(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        autopilot.heard.clear()
        walk(link, link.stop_sequence(), clock)
        assert autopilot.heard == []


class TestFaults:
    def test_stale_positions_are_a_fault(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot.located = False
        clock.now_s += 0.6
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.FAULT

    def test_after_a_fault_it_can_be_enabled_again(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        walk(link, link.stop_sequence(), clock)
        walk(link, link.enable_sequence(), clock)
        assert link.health(clock.now_s).condition is Condition.READY
        assert len(autopilot.commands(ARM)) == 1

    def test_missing_heartbeats_are_a_lost_autopilot(self, connect, clock):
        link, _ = connect("ardupilot_rover")
        drive(link, clock)
        clock.now_s += 3.6
        assert link.health(clock.now_s).condition is Condition.LOST

    def test_a_stop_that_is_not_confirmed_is_said(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot.refuses = {SET_MODE}
        with pytest.raises(BridgeError, match="did not enter HOLD"):
            walk(link, link.stop_sequence(), clock)
        assert len(autopilot.commands(SET_MODE)) > 1

    def test_no_autopilot(self, connect):
        with pytest.raises(BridgeError, match="no heartbeat of system 1 on udpin:h:1"):
            connect("px4", silent=True)

    def test_an_unknown_firmware_timeout_stays_unknown(self, connect):
        link, _ = connect("px4", parameters={})
        assert link.firmware_timeout_s is None

    def test_no_position_is_enough_to_open_but_not_to_move(self, connect, clock):
        link, autopilot = connect("px4", located=False)
        assert link.state() is None
        with pytest.raises(BridgeError, match="TIMESYNC"):
            walk(link, link.enable_sequence(), clock)
        with pytest.raises(BridgeError, match="no position"):
            link.send(command(), clock.now_s)
        assert not autopilot.commands(SET_MODE)

    def test_other_systems_are_not_listened_to(self, connect, clock):
        link, autopilot = connect("px4")
        drive(link, clock)
        stranger = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
        autopilot.receive = lambda: iter([vehicle_frame(stranger, system=255, component=190)])
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.READY

    def test_a_full_port_drops_and_counts(self, connect, clock):
        link, autopilot = connect("px4")
        drive(link, clock)
        autopilot.send = lambda frame: not frame
        link.send(command(), clock.now_s)
        assert link.dropped() == 1


class TestKeepalive:
    def test_the_heartbeat_goes_out_only_while_commands_are_fresh(self, connect, clock):
        link, autopilot = connect("px4")
        autopilot.heard.clear()
        link.keepalive(False, clock.now_s)
        assert [m.get_type() for m in autopilot.heard] == ["TIMESYNC"]
        link.keepalive(True, clock.now_s)
        assert [m.get_type() for m in autopilot.heard] == ["TIMESYNC", "HEARTBEAT", "TIMESYNC"]

    def test_streams_are_asked_for_again_when_they_dry_up(self, connect, clock):
        link, autopilot = connect("px4")
        clock.now_s += 1.0
        autopilot.heard.clear()
        link.keepalive(False, clock.now_s)
        intervals_us = {m.param1: m.param2 for m in autopilot.commands(511)}
        assert intervals_us == {0.0: 200e3, 30.0: 10e3, 32.0: 10e3}  # poses at twice the rate of 50 Hz


class TestSigning:
    """The scripted autopilot signs and judges by pymavlink's own rules."""

    KEY = bytes(range(32))

    @pytest.fixture
    def open_signed(self, clock, monkeypatch, tmp_path):
        def open_signed(tick, key=self.KEY):
            path = tmp_path / "key"
            path.write_bytes(self.KEY)
            path.chmod(0o600)
            autopilot = ScriptedAutopilot("px4", clock)
            if key is not None:
                autopilot.sign(key, tick)
            monkeypatch.setattr(mavlink_channel, "open_transport", lambda _: autopilot)
            options = MavlinkOptions("px4", "udpin:h:1", DYNAMICS, signing_key=str(path))
            link = MavlinkLink(options, 4, LIMITS, clock)
            link.open()
            return link, autopilot

        return open_signed

    @pytest.mark.parametrize("ahead_s", [-3600, 0, 3600])
    def test_both_sides_believe_each_other_whosever_clock_is_behind(self, open_signed, clock, ahead_s):
        link, autopilot = open_signed(clock_ticks() + ahead_s * 100_000)
        drive(link, clock)
        link.send(command(), clock.now_s)
        link.keepalive(True, clock.now_s)
        assert autopilot.setpoints()[-1].get_signed()
        assert autopilot.heard[-1].get_signed()
        assert autopilot.proofs[0] == (ahead_s > 0), "a frame older than our start proves nothing"
        assert autopilot.proofs[-1]
        link.close()

    def test_an_autopilot_that_does_not_sign_is_not_heard(self, open_signed):
        with pytest.raises(BridgeError, match="refused by signing"):
            open_signed(0, key=None)

    def test_an_autopilot_with_another_key_is_not_heard(self, open_signed, monkeypatch):
        monkeypatch.setattr(ScriptedAutopilot, "send", lambda *_: True)
        with pytest.raises(BridgeError, match="altered refused by signing"):
            open_signed(clock_ticks(), key=bytes(32))


class TestOtherWays:
    def test_the_state_may_come_as_odometry(self, connect, clock):
        link, _ = connect("px4", odometry=True)
        assert link.state().position_m == (2.0, 1.0)
        drive(link, clock)

    def test_a_stream_of_bytes_has_no_datagrams(self, connect, clock):
        link, autopilot = connect("px4", datagrams=False)
        data = b"".join(autopilot.receive())
        position = link.state()
        clock.now_s += 0.1
        data = b"".join(autopilot.receive())
        autopilot.receive = lambda: iter([data[:50], data[50:]])
        link.receive(clock.now_s)
        assert link.state().stamp_s > position.stamp_s
        assert link.tally.damaged == 0

    def test_what_was_said_to_nobody_is_not_counted_as_dropped(self, connect):
        link, autopilot = connect("px4")
        assert autopilot.proofs
        assert link.dropped() == 0

    def test_a_refusal_without_words_is_told_by_its_number(self, connect, clock):
        link, _ = connect("px4", refuses={ARM}, complains=False, refusal=4)
        with pytest.raises(BridgeError, match="did not arm: MAV_RESULT 4 to command 400"):
            walk(link, link.enable_sequence(), clock)

    def test_a_silent_refusal_is_told_too(self, connect, clock):
        link, _ = connect("px4", refuses={ARM}, complains=False)
        with pytest.raises(BridgeError, match=r"did not arm$"):
            walk(link, link.enable_sequence(), clock)


def test_a_link_that_is_not_open_says_so(clock):
    link = MavlinkLink(MavlinkOptions("px4", "udpin:h:1", DYNAMICS), 0, LIMITS, clock)
    assert link.filenos() == ()
    link.close()
    with pytest.raises(BridgeError, match="not open"):
        link.receive(0.0)


def test_an_unknown_autopilot_is_refused_with_the_known_ones(clock):
    with pytest.raises(ConfigError, match="ardupilot_rover, ardupilot_copter, px4"):
        MavlinkLink(MavlinkOptions("betaflight", "udpin:h:1", DYNAMICS), 0, LIMITS, clock)
