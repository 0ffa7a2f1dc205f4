import math

import pytest
from guard_fakes import FakeLink, spec
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState
from firmware_bridge.guard.core import MOST_COMPLAINTS, Guard, check_firmware_timeout, limit_fault
from firmware_bridge.guard.link import Condition, Setpoint, SetpointLimits
from firmware_bridge.guard.speeding import Speeding
from firmware_bridge.guard.wire import Complaint, Counts, Event, Phase, encode_command, encode_stop

LIMITS = SetpointLimits(1.0, (-2.0, -2.0), (2.0, 2.0))


class Rig:
    """A guard, its fake link and a clock."""

    def __init__(self, link=None, **changes) -> None:
        self.link = link or FakeLink()
        self.guard = Guard(self.link, spec(**changes))
        self.now, self.sequence = 100.0, -1

    def command(self, velocity=(0.5, 0.0), action=(0.0, 0.0), sequence=None, age=0.0) -> None:
        self.sequence = self.sequence + 1 if sequence is None else sequence
        setpoint = Setpoint(self.sequence, self.now - age, action, velocity)
        self.guard.on_packet(encode_command(setpoint), self.now)
        self.guard.on_time(self.now)

    def wait(self, seconds) -> None:
        self.now += seconds
        self.guard.on_time(self.now)

    def run(self, seconds) -> None:
        """Command every 20 ms."""
        for _ in range(round(seconds / 0.02)):
            self.wait(0.02)
            self.command()

    def settle(self) -> None:
        """Let time pass without commands until nothing is left to do."""
        for _ in range(1000):
            self.wait(0.01)

    def driving(self) -> "Rig":
        self.command()
        self.run(0.3)
        assert self.guard.phase is Phase.DRIVING
        self.link.log.clear()
        self.guard.events.clear()
        return self

    def causes(self) -> list[str]:
        return [event.text for event in self.guard.events]


def test_watches_until_the_first_command():
    rig = Rig()
    rig.settle()
    assert rig.guard.phase is Phase.WATCHING
    assert rig.link.log == []
    assert rig.guard.next_due_s() == math.inf


def test_arms_with_the_first_command_and_then_forwards_each_once():
    rig = Rig()
    rig.command()
    assert rig.link.log == ["enable 1"]
    assert rig.guard.phase is Phase.ENABLING
    rig.run(0.2)
    assert rig.link.log == ["enable 1", "enable 2"]
    rig.run(0.1)
    sent = [entry[1] for entry in rig.link.log[2:]]
    assert len(sent) >= 4
    assert sent == list(range(sent[0], rig.sequence + 1))
    assert rig.causes() == ["first command", "enabled"]
    assert rig.guard.report().counts == Counts(forwarded=len(sent), withheld=sent[0], dropped=7)


def test_without_arm_it_waits_until_the_firmware_is_ready():
    rig = Rig(FakeLink(Condition.WAITING), arm=False)
    rig.run(0.1)
    assert rig.link.log == []
    assert rig.guard.phase is Phase.WATCHING
    rig.link.condition = Condition.READY
    rig.run(0.04)
    assert [entry[0] for entry in rig.link.log] == ["send", "send"]
    assert rig.causes() == ["already enabled"]


def test_a_complaint_of_the_firmware_is_told_once_and_changes_nothing():
    rig = Rig().driving()
    rig.link.warning = "battery low"
    rig.run(0.1)
    rig.link.warning = ""
    rig.run(0.1)
    rig.link.warning = "battery low"
    rig.run(0.1)
    assert list(rig.guard.events) == [Complaint("battery low")]
    assert rig.guard.phase is Phase.DRIVING
    assert [entry[0] for entry in rig.link.log] == ["send"] * 15


def test_a_firmware_that_never_ends_complaining_is_cut_short():
    rig = Rig().driving()
    for number in range(MOST_COMPLAINTS + 10):
        rig.link.warning = f"number {number}"
        rig.run(0.02)
    assert rig.causes() == [f"number {number}" for number in range(MOST_COMPLAINTS)]


def test_a_fault_is_no_mere_complaint():
    rig = Rig().driving()
    rig.link.condition, rig.link.warning = Condition.FAULT, "battery low"
    rig.run(0.02)
    assert rig.causes() == ["detail"]


@pytest.mark.parametrize("condition", [Condition.OVERRIDE, Condition.LOST])
def test_does_not_arm_a_robot_that_is_taken_or_lost(condition):
    rig = Rig(FakeLink(condition))
    rig.run(0.1)
    assert rig.link.log == []
    assert rig.guard.phase is Phase.WATCHING


def test_duplicate_and_stale_commands_are_refused():
    rig = Rig().driving()
    last = rig.sequence
    rig.command(sequence=last)
    rig.command(sequence=last - 1)
    rig.command(sequence=last + 1, age=0.0601)
    assert rig.link.log == []
    assert rig.guard.report().counts.refused == 3
    rig.command(sequence=last + 1, age=0.0599)
    assert rig.link.log == [("send", last + 1)]


def test_refused_commands_do_not_postpone_the_deadline():
    rig = Rig().driving()
    last = rig.sequence
    for _ in range(4):
        rig.wait(0.015)
        rig.command(sequence=last)
    assert rig.guard.phase is Phase.STOPPING


def test_stops_when_commands_end():
    rig = Rig().driving()
    rig.wait(0.0195)
    assert rig.guard.next_due_s() == pytest.approx(rig.now + 0.06 - 0.0195)
    rig.wait(0.0599 - 0.0195)
    assert rig.link.log == []
    rig.wait(0.0002)
    assert rig.link.log == ["stop 1"]
    assert rig.guard.next_due_s() == pytest.approx(rig.now + 0.1)
    rig.wait(0.0999)
    assert rig.link.log == ["stop 1"]
    rig.wait(0.0002)
    assert rig.link.log == ["stop 1", "stop 2"]
    rig.wait(0.1)
    assert rig.guard.phase is Phase.STOPPED
    assert rig.causes() == ["no fresh command for 60 ms", "stop sequence done"]
    assert rig.guard.next_due_s() == math.inf


def test_commands_end_while_enabling():
    rig = Rig()
    rig.command()
    rig.wait(0.07)
    assert rig.link.log == ["enable 1", "stop 1"]
    rig.settle()
    assert rig.link.log == ["enable 1", "stop 1", "stop 2"]


def test_a_stop_is_final():
    rig = Rig().driving()
    rig.guard.on_packet(encode_stop("enough", rig.now), rig.now)
    rig.run(0.5)
    assert rig.link.log == ["stop 1", "stop 2"]
    assert rig.guard.phase is Phase.STOPPED
    assert rig.causes()[0] == "enough"
    assert not rig.guard.finished
    rig.guard.on_leave("left", rig.now)
    assert rig.guard.finished
    assert rig.causes() == ["enough", "stop sequence done"]


def test_leaving_stops_first_and_finishes_then():
    rig = Rig().driving()
    rig.guard.on_leave("left", rig.now)
    assert not rig.guard.finished
    rig.settle()
    assert rig.guard.finished
    assert rig.causes()[0] == "left"


def test_leaving_before_the_first_command_touches_nothing():
    rig = Rig()
    rig.guard.on_leave("left", rig.now)
    assert rig.guard.finished
    assert rig.link.log == []


@pytest.mark.parametrize(
    ("velocity", "action", "said"),
    [
        ((math.nan, 0.0), (0.0, 0.0), "not finite"),
        ((0.0, -math.inf), (0.0, 0.0), "not finite"),
        ((0.0, 0.0), (0.0, math.nan), "not finite"),
        ((0.0, 0.0), (math.nan, 0.0), "not finite"),
        ((0.8, 0.61), (0.0, 0.0), "over the limit of 1 m/s"),
        ((0.0, 0.0), (0.0, -2.01), "-2.010 is outside its limits, -2 to 2"),
        ((0.0, 0.0), (0.0,), "action of 1 components, this robot takes 2"),
        ((0.0, 0.0), (0.0,) * 8, "action of 8 components, this robot takes 2"),
        ((0.0, 0.0, 0.0), (0.0, 0.0), "velocity of 3 components, this robot takes 2"),
    ],
)
def test_a_bad_command_stops(velocity, action, said):
    rig = Rig().driving()
    rig.command(velocity, action)
    assert rig.link.log == ["stop 1"]
    assert said in rig.causes()[0]


def test_limits_themselves_are_allowed():
    assert limit_fault(Setpoint(0, 0.0, (2.0, -2.0), (0.6, 0.8)), LIMITS) == ""
    turning = SetpointLimits(1.0, (-2.0, 0.0, -1.0), (2.0, 1.0, 1.0), yaw_rate_rad_s=1.5, dims=3)
    assert limit_fault(Setpoint(0, 0.0, (-2.0, 0.0, 1.0), (0.0, 0.6, -0.8), -1.5), turning) == ""


@pytest.mark.parametrize("yaw_rate", [0.001, -0.001, math.nan, math.inf])
def test_a_robot_that_is_not_to_turn_is_not_turned(yaw_rate):
    rig = Rig().driving()
    rig.guard.on_packet(encode_command(Setpoint(10**6, rig.now, (0.0, 0.0), (0.0, 0.0), yaw_rate)), rig.now)
    assert rig.link.log == ["stop 1"]


def test_a_command_from_the_future_stops():
    rig = Rig().driving()
    rig.command(age=-0.0009)
    assert rig.link.log == [("send", rig.sequence)]
    rig.command(age=-0.0011)
    assert rig.link.log[1:] == ["stop 1"]
    assert "future" in rig.causes()[0]


def test_a_non_finite_stamp_stops():
    rig = Rig().driving()
    rig.command(age=math.nan)
    assert rig.link.log == ["stop 1"]


@pytest.mark.parametrize("packet", [b"x", bytes(48), encode_command(Setpoint(1, 0.0, (0, 0), (0, 0)))[:-1]])
def test_a_malformed_packet_stops(packet):
    rig = Rig().driving()
    rig.guard.on_packet(packet, rig.now)
    assert rig.link.log == ["stop 1"]
    assert "malformed" in rig.causes()[0]


@given(st.binary(max_size=64), st.integers(0, 48))
def test_no_mutated_packet_moves_a_watched_robot_beyond_its_limits(junk, place):
    rig = Rig(arm=False)
    packet = encode_command(Setpoint(0, rig.now, (0.0, 0.0), (0.5, 0.0)))
    sent = []
    rig.link.send = lambda setpoint, _now: sent.append(setpoint)
    rig.guard.on_packet(packet[:place] + junk + packet[place + len(junk) :], rig.now)
    assert all(limit_fault(setpoint, LIMITS) == "" for setpoint in sent)


def mostly(low, high):
    """Numbers of which most lie within limits, so that commands of many are sometimes in order."""
    return st.floats(low, high) | st.floats(low, high) | st.floats(1.1 * low, 1.1 * high) | st.floats()


@st.composite
def limited_commands(draw):
    """Limits of a robot of d action components, and a command that may keep them, of that length or not."""
    count, dims = draw(st.integers(1, 8)), draw(st.integers(2, 3))
    low, high = [-1.0] * count, draw(st.lists(st.sampled_from([0.0, 2.0]), min_size=count, max_size=count))
    limits = SetpointLimits(1.0, tuple(low), tuple(high), yaw_rate_rad_s=1.5, dims=dims)
    sizes = draw(st.just((count, dims)) | st.tuples(st.integers(1, 8), st.integers(2, 3)))
    action = draw(st.lists(mostly(-1.0, 0.0), min_size=sizes[0], max_size=sizes[0]))
    velocity = draw(st.lists(mostly(-0.5, 0.5), min_size=sizes[1], max_size=sizes[1]))
    stamp, turn = draw(mostly(99.95, 100.0)), draw(mostly(-1.5, 1.5))
    sequence = draw(st.integers(0, 2**64 - 1))
    return limits, Setpoint(sequence, stamp, tuple(action), tuple(velocity), turn)


@given(limited_commands())
def test_only_finite_commands_within_limits_are_forwarded(case):
    limits, setpoint = case
    rig = Rig(arm=False, limits=limits)
    rig.guard.on_packet(encode_command(setpoint), rig.now)
    action, velocity = setpoint.action, setpoint.velocity_m_s
    allowed = (
        len(action) == len(limits.low)
        and len(velocity) == limits.dims
        and all(-1.0 <= value <= high for value, high in zip(action, limits.high, strict=True))
        and math.hypot(*velocity) <= 1.0
        and abs(setpoint.yaw_rate_rad_s) <= 1.5
        and rig.now - 0.06 <= setpoint.stamp_s <= rig.now + 0.001
    )
    assert (rig.link.log == [("send", setpoint.sequence)]) == allowed


def test_a_refused_setpoint_stops():
    rig = Rig().driving()
    rig.link.failing = {"send"}
    rig.command()
    assert rig.link.log == ["stop 1"]
    assert rig.causes() == ["send failed"]


def test_a_lost_bus_stops_and_is_not_listened_to_again():
    rig = Rig().driving()
    assert rig.guard.filenos == (0,)
    rig.guard.on_feedback(rig.now)
    assert rig.link.log == ["receive"]
    rig.link.failing = {"receive"}
    rig.guard.on_feedback(rig.now)
    assert rig.link.log == ["receive", "stop 1"]
    assert rig.guard.filenos == ()
    rig.run(1.0)
    assert rig.guard.phase is Phase.STOPPED


def test_a_lost_condition_stops():
    rig = Rig().driving()
    rig.link.condition = Condition.LOST
    rig.wait(0.001)
    assert rig.link.log == ["stop 1"]
    assert rig.causes() == ["detail"]


def test_after_an_override_nothing_is_sent_ever():
    rig = Rig(FakeLink(recoveries=3)).driving()
    rig.link.condition = Condition.OVERRIDE
    rig.wait(0.001)
    rig.link.condition = Condition.READY
    rig.run(0.5)
    rig.guard.on_leave("left", rig.now)
    assert rig.link.log == []
    assert rig.guard.finished
    assert rig.causes() == ["detail"]


def test_an_override_between_two_looks_goes_before_a_stop():
    rig = Rig().driving()
    rig.link.condition = Condition.OVERRIDE
    rig.guard.stop("other cause", rig.now)
    rig.settle()
    assert rig.link.log == []


def test_a_fault_stops_enables_again_and_latches_after_the_allowed_number():
    rig = Rig(FakeLink(recoveries=2)).driving()
    for _ in range(2):
        rig.link.condition = Condition.FAULT
        rig.wait(0.001)
        assert rig.guard.phase is Phase.RECOVERING
        rig.run(0.1)
        rig.link.condition = Condition.READY
        rig.run(0.5)
        assert rig.guard.phase is Phase.DRIVING
    sequences = [entry for entry in rig.link.log if isinstance(entry, str)]
    assert sequences == ["stop 1", "stop 2", "enable 1", "enable 2"] * 2
    rig.link.condition = Condition.WAITING
    rig.wait(0.001)
    assert rig.guard.phase is Phase.STOPPING
    assert rig.causes()[-1] == "detail after 2 recoveries"
    assert rig.guard.report().counts.recoveries == 2


def test_nothing_is_forwarded_between_a_fault_and_its_detection():
    rig = Rig(FakeLink(recoveries=1)).driving()
    rig.link.condition = Condition.FAULT
    rig.command()
    assert rig.link.log == ["stop 1"]


def test_without_arm_a_fault_is_final():
    rig = Rig(FakeLink(recoveries=2), arm=False)
    rig.run(0.04)
    rig.link.condition = Condition.FAULT
    rig.wait(0.001)
    assert rig.guard.phase is Phase.STOPPING
    assert rig.causes()[-1] == "detail"


def test_a_failed_recovery_counts():
    rig = Rig(FakeLink(recoveries=2)).driving()
    rig.link.condition = Condition.FAULT
    rig.link.failing = {"enable 1"}
    rig.run(0.5)
    assert rig.guard.report().counts.recoveries == 2
    assert rig.guard.phase is Phase.STOPPING
    assert rig.causes()[-1] == "enable 1 failed after 2 recoveries"


def test_commands_end_while_recovering():
    rig = Rig(FakeLink(recoveries=2)).driving()
    rig.link.condition = Condition.FAULT
    rig.settle()
    assert rig.guard.phase is Phase.STOPPED
    assert rig.link.log == ["stop 1", "stop 1", "stop 2"]


def test_failed_enabling_stops():
    rig = Rig()
    rig.link.failing = {"enable 2"}
    rig.command()
    rig.run(0.2)
    assert rig.link.log == ["enable 1", "stop 1"]
    assert rig.causes()[1] == "enable 2 failed"


def test_a_failed_stop_is_told_and_final():
    rig = Rig().driving()
    rig.link.failing = {"stop 2"}
    rig.settle()
    assert rig.guard.phase is Phase.STOPPED
    assert rig.causes()[-1] == "stop sequence failed: stop 2 failed"


def test_an_endless_stop_sequence_is_cut_off():
    rig = Rig().driving()
    rig.link.stop_delay_s = 6.0
    rig.guard.stop("enough", rig.now)
    rig.wait(6.0)
    assert rig.guard.phase is Phase.STOPPING
    rig.wait(6.0)
    assert rig.guard.phase is Phase.STOPPED


def test_the_heartbeat_is_fresh_only_while_commands_arrive():
    rig = Rig(FakeLink(keepalive_period_s=0.05))
    rig.wait(0.0)
    assert rig.link.log == [("keepalive", False)]
    assert rig.guard.next_due_s() == pytest.approx(rig.now + 0.05)
    rig.driving()
    rig.run(0.1)
    beats = [entry for entry in rig.link.log if entry[0] == "keepalive"]
    assert set(beats) == {("keepalive", True)}
    rig.link.log.clear()
    rig.wait(0.06)
    rig.settle()
    assert ("keepalive", True) not in rig.link.log
    assert ("keepalive", False) in rig.link.log


def test_the_heartbeat_ends_with_a_stop():
    rig = Rig(FakeLink(keepalive_period_s=0.01)).driving()
    rig.guard.on_packet(encode_stop("enough", rig.now), rig.now)
    rig.run(0.02)
    assert ("keepalive", True) not in rig.link.log


def test_a_failing_heartbeat_stops():
    rig = Rig(FakeLink(keepalive_period_s=0.01)).driving()
    rig.link.failing = {"keepalive"}
    rig.wait(0.01)
    assert rig.link.log == ["stop 1"]


def test_reports_the_newest_state():
    rig = Rig()
    assert rig.guard.report().state is None
    rig.link.newest = RobotState(1, 2.0, (3.0, 4.0), (5.0, 6.0))
    assert rig.guard.report().state is rig.link.newest


def test_events_tell_phase_and_cause():
    rig = Rig()
    rig.command()
    assert list(rig.guard.events) == [Event(Phase.ENABLING, "first command")]


@pytest.mark.parametrize(
    ("timeout_s", "said"), [(None, "unknown"), (0.0, "off"), (1.01, "1.01 s"), (-1.0, "-1 s")]
)
def test_firmware_timeouts_that_do_not_protect_are_refused(timeout_s, said):
    link = FakeLink()
    link.firmware_timeout_s = timeout_s
    with pytest.raises(ConfigError, match=said):
        check_firmware_timeout(link, allow_unsafe=False)
    check_firmware_timeout(link, allow_unsafe=True)


@pytest.mark.parametrize("timeout_s", [0.001, 0.5, 1.0])
def test_firmware_timeouts_up_to_a_second_are_fine(timeout_s):
    link = FakeLink()
    link.firmware_timeout_s = timeout_s
    check_firmware_timeout(link, allow_unsafe=False)


class TestMeasuredSpeed:
    """Limit 1 m/s: a robot that is measured above it for long is stopped, whatever it was commanded."""

    @staticmethod
    def going(speed_m_s):
        return RobotState(1, 100.0, (0.0, 0.0), (speed_m_s * 0.6, -speed_m_s * 0.8), 0.0)

    @pytest.mark.parametrize(("speed_m_s", "stops"), [(1.0, False), (1.29, False), (1.31, True), (3.0, True)])
    def test_it_may_overshoot_and_not_speed(self, speed_m_s, stops):
        rig = Rig(FakeLink(recoveries=3)).driving()
        rig.link.newest = self.going(speed_m_s)
        rig.run(1.0)
        assert (rig.guard.phase >= Phase.STOPPING) is stops
        if stops:
            assert rig.causes()[0] == f"the robot goes at {speed_m_s:.2f} m/s, over the limit of 1 m/s"
            assert rig.guard.report().counts.recoveries == 0

    def test_for_a_moment_it_may(self):
        rig = Rig().driving()
        for _ in range(5):
            rig.link.newest = self.going(2.0)
            rig.run(0.46)
            rig.link.newest = self.going(0.5)
            rig.run(0.04)
        assert rig.guard.phase is Phase.DRIVING

    def test_by_hand_it_may(self):
        rig = Rig(FakeLink(Condition.WAITING), arm=False)
        rig.link.newest = self.going(3.0)
        rig.run(2.0)
        assert rig.guard.phase is Phase.WATCHING


def test_a_robot_may_overshoot_a_little_for_long_and_much_for_half_a_second():
    def fault(speed_m_s, now_s):
        state = RobotState(0, now_s, (0.0, 0.0), (0.0, speed_m_s))
        return speeding.fault(state, now_s)

    speeding = Speeding(0.5)
    assert fault(2.0, 0.0) == fault(0.67, 0.5) == fault(0.67, 9.0) == fault(0.68, 9.5) == ""
    assert fault(0.68, 9.6) == "the robot goes at 0.68 m/s, over the limit of 0.5 m/s"


def test_a_robot_that_tells_no_speed_is_not_too_fast():
    speeding = Speeding(0.5)
    assert speeding.fault(None, 0.0) == speeding.fault(None, 9.0) == ""
