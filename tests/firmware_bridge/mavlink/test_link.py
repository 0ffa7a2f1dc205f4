import itertools
import re

import pytest
from mavlink_peers import HOME, ScriptedAutopilot, Ticks, vehicle_frame
from pymavlink.dialects.v20 import ardupilotmega as common

import firmware_bridge.mavlink.channel as mavlink_channel
from edge_runtime.errors import BridgeError, ConfigError
from edge_runtime.motion.models import PointForce
from firmware_bridge.guard.link import Condition, Setpoint, SetpointLimits
from firmware_bridge.mavlink.link import MavlinkLink
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.signing import clock_ticks

SET_MODE, ARM, SET_INTERVAL = 176, 400, 511
POSE_S = 0.02
DYNAMICS = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1).at_period(0.02)
LIMITS = SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0))


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
        connect.autopilot = autopilot
        monkeypatch.setattr(mavlink_channel, "open_transport", lambda _: autopilot)
        options = MavlinkOptions(profile, "udpin:h:1", DYNAMICS, point_ahead_m=0.5)
        link = MavlinkLink(options, 4, LIMITS, clock)
        link.open()
        return link, autopilot

    return connect


def walk(link, steps, clock, during=lambda: None):
    """Run a sequence as the guard does: feedback during the steps."""
    for delay_s in steps:
        during()
        wait(link, clock, delay_s)


def wait(link, clock, wait_s):
    end_s = clock.now_s + wait_s
    while clock.now_s < end_s:
        clock.now_s += POSE_S
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
        assert autopilot.armed is (profile == "ardupilot_copter")
        drive(link, clock)
        assert autopilot.armed
        assert autopilot.mode == PROFILES[profile].command_mode.reported
        moving = [m for m in autopilot.setpoints() if m.vx or m.vy or m.afx or m.afy or m.yaw_rate]
        assert not moving

    def test_the_mode_comes_before_the_arming(self, connect, clock, profile):
        link, autopilot = connect(profile)
        drive(link, clock)
        order = [m.command for m in autopilot.heard if getattr(m, "command", 0) in (SET_MODE, ARM)]
        assert order == [SET_MODE, ARM] if profile != "ardupilot_copter" else [SET_MODE]

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
        zero, (mode,) = autopilot.heard[0], autopilot.commands(SET_MODE)
        assert (zero.vx, zero.vy, zero.yaw_rate) == (0.0, 0.0, 0.0)
        assert not zero.type_mask & 0x38
        before = autopilot.heard[: autopilot.heard.index(mode)]
        assert all(message in autopilot.setpoints() for message in before)
        assert autopilot.mode == PROFILES[profile].stop_mode.reported
        assert link.health(clock.now_s).condition is Condition.WAITING

    def test_acknowledgements_do_not_count_as_a_mode(self, connect, clock, profile):
        link, autopilot = connect(profile, refuses={SET_MODE})
        with pytest.raises(BridgeError, match=PROFILES[profile].command_mode.name):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(ARM)


@pytest.mark.parametrize("profile", ["ardupilot_rover", "px4"])
def test_acknowledgements_do_not_count_as_arming(connect, clock, profile):
    link, _ = connect(profile, refuses={ARM})
    with pytest.raises(BridgeError, match="did not arm: Arm: compass not calibrated"):
        walk(link, link.enable_sequence(), clock)


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
        assert list(link.stop_sequence()) == []
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
        assert link.health(clock.now_s).condition is Condition.WAITING, (
            "how often its pose comes is not known"
        )
        wait(link, clock, 1.2)
        assert link.health(clock.now_s).condition is Condition.READY
        link.send(command((0.0, 0.0), (1e-3, 0.0)), clock.now_s)
        autopilot.mode = 0
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.OVERRIDE

    def test_a_robot_that_was_never_taken_is_not_stopped(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        autopilot.heard.clear()
        assert list(link.stop_sequence()) == []
        assert autopilot.heard == []

    @pytest.mark.parametrize("mode", ["stop_mode", "command_mode"])
    def test_the_guards_own_modes_are_an_operators_where_it_did_not_command_them(self, connect, clock, mode):
        """HOLD chosen by hand while GUIDED is driven, and GUIDED chosen by hand after a stop."""
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        if mode == "command_mode":
            walk(link, link.stop_sequence(), clock)
        autopilot.mode = getattr(autopilot.profile, mode).reported
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.OVERRIDE

    def test_a_failsafe_of_the_autopilot_keeps_the_robot(self, connect, clock):
        link, autopilot = connect("ardupilot_rover", station_failsafe=True)
        link.keepalive(True, clock.now_s)
        drive(link, clock)
        wait(link, clock, 6.0)
        assert link.health(clock.now_s).condition is Condition.OVERRIDE
        assert list(link.stop_sequence()) == []
        assert len(autopilot.commands(SET_MODE)) == 1


class TestFaults:
    def test_stale_positions_are_a_fault(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot.located = False
        clock.now_s += 0.6
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.FAULT

    def test_no_fault_is_answered_by_taking_it_again(self):
        """HOLD by an operator's hand cannot be told from a recovery's own."""
        assert MavlinkLink.recoveries == 0

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
        with pytest.raises(BridgeError, match="no position from the autopilot for"):
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
        autopilot.answered.clear()
        link.send(command(), clock.now_s)
        assert link.dropped() == 1


class TestKeepalive:
    def test_the_heartbeat_goes_out_only_while_commands_are_fresh(self, connect, clock):
        link, autopilot = connect("px4")
        autopilot.heard.clear()
        told = []
        for fresh, later_s in ((False, 0.0), (True, 0.1), (True, 0.5)):
            link.keepalive(fresh, clock.now_s + later_s)
            told.append([m.get_type() for m in autopilot.heard if m.get_type() != "COMMAND_LONG"])
        assert told == [["TIMESYNC"], ["TIMESYNC"], ["TIMESYNC", "HEARTBEAT", "TIMESYNC"]]

    def test_a_pose_that_stays_away_is_asked_for_though_nothing_else_comes(self, connect, clock):
        link, autopilot = connect("px4", punctual=True)
        wait(link, clock, 1.0)
        autopilot.heard.clear()
        link.keepalive(False, clock.now_s + 0.15)
        assert {m.param1 for m in autopilot.commands(SET_INTERVAL)} & {30.0, 32.0}


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
        assert set(autopilot.answered) == {HOME}
        assert (len(autopilot.answered) == 1) == (ahead_s > 0), "a frame older than our start proves nothing"
        link.close()

    def test_an_autopilot_that_does_not_sign_is_not_heard(self, open_signed):
        with pytest.raises(BridgeError, match="refused by signing"):
            open_signed(0, key=None)

    def test_an_autopilot_with_another_key_is_not_heard(self, open_signed, monkeypatch):
        monkeypatch.setattr(ScriptedAutopilot, "send", lambda *_: None)
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
        assert autopilot.dropped > 0
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


class TestOneAutopilot:
    """The first address that sends an autopilot's heartbeat is its home; two of them are one too many."""

    ELSEWHERE = ("10.0.0.3", 14550)

    def heartbeat(self, autopilot=3, mode=0, kind=10):
        return vehicle_frame(common.MAVLink_heartbeat_message(kind, autopilot, 0x81, mode, 4, 3))

    def test_a_second_vehicle_with_its_number_is_not_driven_beside(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        autopilot.others.append((self.ELSEWHERE, self.heartbeat()))
        with pytest.raises(BridgeError, match=r"two vehicles .* 10\.0\.0\.2:14550 and at 10\.0\.0\.3:14550"):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(SET_MODE)
        assert not autopilot.setpoints()

    def test_one_that_appears_later_stops_the_first(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot.others.append((self.ELSEWHERE, self.heartbeat()))
        link.receive(clock.now_s)
        health = link.health(clock.now_s)
        assert health.condition is Condition.FAULT
        assert "two vehicles have one system id" in health.detail
        walk(link, link.stop_sequence(), clock)
        assert autopilot.mode == PROFILES["ardupilot_rover"].stop_mode.reported

    def test_nothing_goes_to_the_second_and_nothing_is_believed_of_it(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        position = vehicle_frame(common.MAVLink_local_position_ned_message(10**6, 99.0, 99.0, 0, 0, 0, 0))
        autopilot.others += [(self.ELSEWHERE, self.heartbeat(mode=4)), (self.ELSEWHERE, position)]
        link.receive(clock.now_s)
        assert set(autopilot.answered) == {HOME}
        assert max(map(abs, link.state().position_m)) < 5.0

    @pytest.mark.parametrize("sender", [HOME, ELSEWHERE])
    def test_a_heartbeat_that_says_no_autopilot_sent_it_is_none(self, connect, clock, sender):
        """A station under component 1: it chose no mode."""
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot.others.append((sender, self.heartbeat(autopilot=8, kind=6)))
        link.receive(clock.now_s)
        assert link.health(clock.now_s).condition is Condition.READY

    def test_such_heartbeats_alone_are_no_autopilot(self, connect, monkeypatch):
        monkeypatch.setattr(ScriptedAutopilot, "receive", lambda _: [self.heartbeat(autopilot=8, kind=6)])
        with pytest.raises(BridgeError, match=r"no heartbeat of system 1 .* \d+ heartbeats under its number"):
            connect("ardupilot_rover")

    def test_a_vehicle_that_started_again_is_stopped(self, connect, clock):
        link, autopilot = connect("ardupilot_rover")
        drive(link, clock)
        autopilot._born_s += 50.0
        link.receive(clock.now_s)
        health = link.health(clock.now_s)
        assert health.condition is Condition.FAULT
        assert "clock jumped by -50.0 s" in health.detail


class TestTheKindOfVehicle:
    @pytest.mark.parametrize(
        ("profile", "kind", "maker", "fitting"),
        [
            ("ardupilot_copter", common.MAV_TYPE_GROUND_ROVER, 3, "ardupilot_rover"),
            ("ardupilot_rover", common.MAV_TYPE_QUADROTOR, 3, "ardupilot_copter"),
            ("ardupilot_rover", common.MAV_TYPE_GROUND_ROVER, 12, "px4"),
        ],
    )
    def test_one_that_the_profile_is_not_for_is_refused(self, connect, profile, kind, maker, fitting):
        with pytest.raises(BridgeError, match=f"is not what .*; pass --mavlink-autopilot {fitting}"):
            connect(profile, vehicle_type=kind, autopilot_type=maker)
        assert not connect.autopilot.commands(SET_MODE)

    @pytest.mark.parametrize("profile", ["ardupilot_copter", "px4"])
    def test_a_copter_on_the_ground_is_not_armed(self, connect, clock, profile):
        link, autopilot = connect(profile, vehicle_type=2, landed=True, armed=False)
        with pytest.raises(BridgeError, match="the copter is on the ground"):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(SET_MODE)
        assert not autopilot.commands(ARM)
        assert list(link.stop_sequence()) == []

    def test_nor_driven_where_somebody_armed_it_by_hand(self, connect, clock):
        link, _ = connect("ardupilot_copter", landed=True, armed=True, mode=4)
        wait(link, clock, 1.5)
        health = link.health(clock.now_s)
        assert (health.condition, "on the ground" in health.detail) == (Condition.WAITING, True)


class TestTimeouts:
    def test_a_rovers_own_is_three_seconds_unless_a_script_tells_another(self, connect):
        assert connect("ardupilot_rover", parameters={})[0].firmware_timeout_s == 3.0
        assert connect("ardupilot_rover", parameters={"GUID_TIMEOUT": 0.5})[0].firmware_timeout_s == 0.5

    def test_an_integers_bytes_are_no_number(self, connect, clock):
        """PX4 sends integers as they lie in memory: 500 reads as 7e-43."""
        link, autopilot = connect("px4", parameters={})
        frame = vehicle_frame(common.MAVLink_param_value_message(b"COM_OF_LOSS_T", 7e-43, 6, 1, 0))
        autopilot.others.append((HOME, frame))
        link.receive(clock.now_s)
        assert link.firmware_timeout_s is None

    def test_a_negative_one_is_off(self, connect):
        assert connect("px4", parameters={"COM_OF_LOSS_T": -1.0})[0].firmware_timeout_s == 0.0


class TestAnswers:
    @pytest.mark.parametrize("key", ["", "the key"])
    def test_a_vehicle_that_hears_nothing_is_told_at_once(self, connect, monkeypatch, key):
        """It wants signed frames, or the wire towards it is cut."""
        del key
        monkeypatch.setattr(ScriptedAutopilot, "send", lambda *_: None)
        with pytest.raises(BridgeError, match=r"sends heartbeats but answers nothing: .*signing-key"):
            connect("ardupilot_rover")


class TestStreams:
    def test_what_is_faster_than_the_scheduler_grants_is_not_asked_for(self, connect, clock):
        """Rover's own SCHED_LOOP_RATE: 10 ms would be denied, and the position stay at what it was."""
        link, autopilot = connect("ardupilot_rover", loop_rate_hz=50.0, punctual=True)
        assert autopilot.intervals.period_s[32] == pytest.approx(0.025)
        drive(link, clock)
        wait(link, clock, 5.0)
        assert link.health(clock.now_s).condition is Condition.READY

    def test_the_pose_is_asked_for_twice_a_period_where_that_is_granted(self, connect):
        _, autopilot = connect("px4", punctual=True)
        seen = {
            message: pytest.approx(period_s) for message, period_s in autopilot.intervals.period_s.items()
        }
        assert seen == {0: 0.2, 30: 0.01, 32: 0.01, 230: 0.2, 24: 0.2, 245: 0.2}

    def test_poses_too_seldom_for_the_control_rate_are_refused_with_both_numbers(self, connect, clock):
        link, autopilot = connect("ardupilot_rover", loop_rate_hz=10.0, punctual=True)
        with pytest.raises(
            BridgeError, match=r"every 12\d ms, but --rate 50 needs one every 60 ms \(125 ms granted\)"
        ):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(SET_MODE)

    def test_a_denied_interval_is_named(self, connect, clock):
        link, _ = connect("px4", loop_rate_hz=5.0, punctual=True)
        with pytest.raises(
            BridgeError, match=r"comes every 2\d\d ms, .* \(10 ms refused with MAV_RESULT 2\)"
        ):
            walk(link, link.enable_sequence(), clock)

    def test_a_station_that_asks_for_other_streams_is_overruled(self, connect, clock):
        link, autopilot = connect("ardupilot_rover", punctual=True)
        drive(link, clock)
        for _ in range(5):
            autopilot.intervals.request_all(4)
            wait(link, clock, 1.0)
            assert link.health(clock.now_s).condition is Condition.READY
        assert autopilot.intervals.period_s[32] == pytest.approx(0.01)

    def test_one_that_insists_stops_the_run_with_that_reason(self, connect, clock):
        link, autopilot = connect("ardupilot_rover", punctual=True)
        drive(link, clock)
        autopilot.intervals.request_all(4)
        autopilot.refuses, autopilot.complains = {SET_INTERVAL}, False
        wait(link, clock, 1.5)
        assert link.health(clock.now_s).condition is Condition.READY
        wait(link, clock, 2.0)
        health = link.health(clock.now_s)
        assert health.condition is Condition.FAULT
        assert re.search(r"its pose comes every 2\d\d ms, .* \(10 ms granted\)", health.detail)
        assert "keep other stations off this link" in health.detail

    def test_the_intervals_of_before_are_given_back(self, connect):
        link, autopilot = connect("px4", punctual=True)
        autopilot.close = lambda: None
        link.close()
        assert set(autopilot.intervals.period_s.values()) == {0.25}

    def test_an_autopilot_that_acknowledges_nothing_is_asked_all_the_same(self, connect, clock):
        link, autopilot = connect("px4", refuses={SET_INTERVAL, 510}, refusal=5, complains=False)
        asked = {int(m.param1) for m in autopilot.commands(SET_INTERVAL)}
        assert asked == {0, 24, 30, 32, 230, 245}
        drive(link, clock)


class TestSoundness:
    @pytest.mark.parametrize(
        ("trait", "value", "wait_s", "said"),
        [
            ("estimator_flags", 0x00A7, 0.5, "does not vouch for its position"),
            ("estimator_flags", 0x833F, 0.5, "does not vouch for its position"),
            ("test_ratio", 1.5, 2.0, "rejects its measurements"),
            ("gps_lost", True, 2.0, "the GPS has lost its fix"),
            ("fix", 1, 2.0, "the GPS has lost its fix"),
        ],
    )
    @pytest.mark.parametrize("profile", ["ardupilot_rover", "px4"])
    def test_a_robot_is_not_driven_by_a_position_that_is_not_sound(
        self, connect, clock, profile, trait, value, wait_s, said
    ):
        link, autopilot = connect(profile, punctual=True)
        drive(link, clock)
        setattr(autopilot, trait, value)
        wait(link, clock, wait_s)
        health = link.health(clock.now_s)
        assert health.condition is Condition.FAULT
        assert said in health.detail

    def test_nor_taken_before_it_is(self, connect, clock):
        link, autopilot = connect("ardupilot_rover", estimator_flags=0x00A7)
        with pytest.raises(BridgeError, match="does not vouch"):
            walk(link, link.enable_sequence(), clock)
        assert not autopilot.commands(SET_MODE)
        autopilot.estimator_flags = 0x033F
        drive(link, clock)

    def test_a_position_set_anew_stops_it(self, connect, clock):
        link, autopilot = connect("px4", odometry=True)
        drive(link, clock)
        autopilot.resets += 1
        link.receive(clock.now_s)
        health = link.health(clock.now_s)
        assert (health.condition, health.detail) == (
            Condition.FAULT,
            "the estimator set its position anew",
        )
