"""What the guard says of each cause, and the times and freshness that its link is told."""

import pytest
from guard_fakes import FakeLink, spec

from edge_runtime.errors import ConfigError
from firmware_bridge.guard.core import (
    CLOCK_TOLERANCE_S,
    LONGEST_STOP_S,
    Guard,
    check_firmware_timeout,
    limit_fault,
)
from firmware_bridge.guard.link import Condition, Setpoint, SetpointLimits
from firmware_bridge.guard.wire import (
    Counts,
    Event,
    Phase,
    Report,
    encode_command,
    encode_event,
    encode_report,
    encode_stop,
)


class TimedLink(FakeLink):
    """Notes the time with which it is called."""

    def __init__(self, **arguments) -> None:
        super().__init__(**arguments)
        self.times: list[tuple[str, object]] = []

    def receive(self, now_s) -> None:
        self.times.append(("receive", now_s))
        super().receive(now_s)

    def keepalive(self, fresh, now_s) -> None:
        self.times.append(("keepalive", now_s))
        super().keepalive(fresh, now_s)

    def health(self, now_s):
        assert isinstance(now_s, float)
        return super().health(now_s)

    def send(self, setpoint, now_s) -> None:
        self.times.append(("send", now_s))
        super().send(setpoint, now_s)


def command(guard, now_s, sequence=0):
    guard.on_packet(encode_command(Setpoint(sequence, now_s, (0.0, 0.0), (0.5, 0.0))), now_s)


def driving(link, **changes):
    """A guard of a robot that already takes commands, at 100 s."""
    guard = Guard(link, spec(arm=False, **changes))
    command(guard, 100.0)
    assert guard.phase is Phase.DRIVING
    guard.events.clear()
    return guard


def causes(guard):
    return [(event.phase, event.text) for event in guard.events]


def test_the_link_is_told_the_time():
    link = TimedLink(keepalive_period_s=1.0)
    guard = driving(link)
    guard.on_feedback(100.01)
    guard.on_time(100.02)
    assert link.times == [("send", 100.0), ("receive", 100.01), ("keepalive", 100.02)]


@pytest.mark.parametrize("what", ["receive", "keepalive", "send"])
def test_a_link_that_fails_is_the_reason_of_the_stop(what):
    link = FakeLink(keepalive_period_s=1.0)
    guard = driving(link)
    link.failing.add(what)
    {
        "receive": lambda: guard.on_feedback(100.01),
        "keepalive": lambda: guard.on_time(100.01),
        "send": lambda: command(guard, 100.01, sequence=1),
    }[what]()
    assert causes(guard) == [(Phase.STOPPING, f"{what} failed")]


def test_a_recovery_says_why():
    link = FakeLink(recoveries=1)
    guard = Guard(link, spec(deadline_s=0.5))
    command(guard, 100.0)
    for tenth in range(1, 4):
        guard.on_time(100.0 + 0.1 * tenth)
        command(guard, 100.0 + 0.1 * tenth, sequence=tenth)
    assert guard.phase is Phase.DRIVING
    guard.events.clear()
    link.condition, link.detail = Condition.FAULT, "the motor is hot"
    guard.on_time(100.31)
    assert causes(guard) == [(Phase.RECOVERING, "the motor is hot")]


def test_a_command_is_no_longer_fresh_at_the_deadline():
    """Also while the guard only watches, and its heartbeat tells others that commands arrive."""
    link = FakeLink(condition=Condition.WAITING, keepalive_period_s=0.25)
    guard = Guard(link, spec(arm=False, deadline_s=0.5))
    command(guard, 100.0)
    for now_s in (100.0, 100.25, 100.5):
        guard.on_time(now_s)
    assert link.log == [("keepalive", True), ("keepalive", True), ("keepalive", False)]


def test_a_request_to_stop_carries_no_sequence():
    assert encode_stop("done", 1.0)[4:12] == bytes(8)


@pytest.mark.parametrize(("timeout_s", "known"), [(None, "unknown"), (0.0, "off"), (2.5, "2.5 s")])
def test_a_firmware_timeout_that_does_not_serve_is_named_with_the_remedy(timeout_s, known):
    link = FakeLink()
    link.firmware_timeout_s = timeout_s
    with pytest.raises(ConfigError) as caught:
        check_firmware_timeout(link, allow_unsafe=False)
    assert str(caught.value) == (
        f"the firmware's command timeout is {known}, not between 0 and 1 s: "
        "set it as edge-doctor says, or pass --allow-unsafe-firmware-timeout"
    )


def test_reports_tell_the_phase():
    guard = Guard(FakeLink(), spec(arm=False))
    assert guard.report().phase is Phase.WATCHING
    command(guard, 100.0)
    assert guard.report().phase is Phase.DRIVING


def test_silence_is_told_in_milliseconds():
    guard = driving(FakeLink(), deadline_s=1.0)
    guard.on_time(101.0)
    assert causes(guard) == [(Phase.STOPPING, "no fresh command for 1000 ms")]


def test_a_stop_sequence_ends_at_its_bound_at_the_latest():
    link = FakeLink()
    link.stop_delay_s = LONGEST_STOP_S
    guard = driving(link)
    guard.stop("enough", 100.0)
    guard.on_time(100.0 + LONGEST_STOP_S)
    assert guard.phase is Phase.STOPPED


def test_a_report_without_a_state_holds_zeros_in_its_place():
    packet = encode_report(Report(Phase.WATCHING, Counts(), None), 1.0)
    robot_id, state = packet[4:12], packet[21:86]
    assert robot_id == bytes(8)
    assert state == bytes(65)


def test_an_event_carries_no_sequence():
    assert encode_event(Event(Phase.STOPPED, "done"), 1.0)[4:12] == bytes(8)


def fault(velocity=(0.0, 0.0), action=(0.0, 0.0)):
    return limit_fault(Setpoint(0, 100.0, action, velocity), SetpointLimits(1.0, (-2.0, -2.0), (2.0, 2.0)))


def test_rounding_is_not_over_the_limit_and_more_is():
    """A command at the limit may come a rounding above it, from another order of the same sums."""
    assert fault(velocity=(1.0 + 1e-9, 0.0)) == ""
    assert fault(velocity=(1.001, 0.0)) == "command of 1.001 m/s is over the limit of 1 m/s"
    assert fault(action=(0.0, -2.0 * (1.0 + 1e-9))) == ""
    assert fault(action=(0.0, -2.001)) == "action of -2.001 is outside its limits, -2 to 2"
    assert fault(velocity=(float("nan"), 0.0)) == "command is not finite"


def test_a_stamp_may_lie_a_millisecond_in_the_future_and_no_more():
    guard = driving(FakeLink())
    stamp_s = 100.0 + CLOCK_TOLERANCE_S
    guard.on_packet(encode_command(Setpoint(1, stamp_s, (0.0, 0.0), (0.5, 0.0))), 100.0)
    assert guard.phase is Phase.DRIVING
    guard.on_packet(encode_command(Setpoint(2, 100.5, (0.0, 0.0), (0.5, 0.0))), 100.0)
    assert causes(guard) == [(Phase.STOPPING, "command is stamped 0.500 s in the future")]


def test_a_command_as_old_as_the_deadline_is_the_last_that_is_taken():
    guard = driving(FakeLink(), deadline_s=0.5)
    for sequence, age_s in ((1, 0.5), (2, 0.51)):
        guard.on_packet(encode_command(Setpoint(sequence, 100.0 - age_s, (0.0, 0.0), (0.5, 0.0))), 100.0)
    counts = guard.report().counts
    assert (counts.forwarded, counts.refused) == (2, 1)


def test_a_stop_asks_for_the_health_of_now():
    guard = driving(TimedLink())
    guard.stop("enough", 100.01)
    assert causes(guard) == [(Phase.STOPPING, "enough")]


@pytest.mark.parametrize(
    ("packet", "said"),
    [
        (b"\x63\xcf", "2 bytes are no frame"),
        (b"\x63\xcf" + bytes(18), "kind 0 in 20 bytes"),
        (bytes(20), "magic 0x0000 instead of 0xcf63"),
    ],
)
def test_a_malformed_packet_is_described(packet, said):
    guard = driving(FakeLink())
    guard.on_packet(packet, 100.01)
    assert causes(guard) == [(Phase.STOPPING, f"malformed command ({said})")]
