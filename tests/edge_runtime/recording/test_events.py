"""Events between ticks: what begins and ends is told once."""

from msgspec.structs import replace

from edge_runtime.messages import Command, GuidedAction, RobotState, Teammate, TeamState
from edge_runtime.recording.events import changes
from edge_runtime.recording.schema import EVENTS, Inputs, Observation, StageTimes, Tick


def state(robot_id):
    return RobotState(robot_id, 0.0, (0.0, 0.0), (0.0, 0.0))


TICK = Tick(
    Inputs(0, 0.0, 0, 0, (0.0, 0.0), (0.0, 0.0)),
    TeamState(state(0), (Teammate(state(1)), Teammate(state(2)))),
    Observation((0.0,)),
    GuidedAction((0.0, 0.0), 10),
    Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0)),
    StageTimes(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


def after(tick, number=1, misses=0, reason="", mates=(1, 2), **action):
    return replace(
        tick,
        inputs=replace(tick.inputs, number=number, misses=misses),
        state=TeamState(state(0), tuple(Teammate(state(mate)) for mate in mates)),
        action=replace(TICK.action, **action),
        command=replace(tick.command, stop_reason=reason),
    )


def told(before, tick):
    events = list(changes(before, tick, 0))
    assert all(event.name in EVENTS for event in events)
    return [event.name for event in events]


def test_nothing_is_told_of_a_tick_like_the_one_before():
    assert told(None, TICK) == told(TICK, after(TICK)) == []


def test_a_fault_is_told_when_it_begins_changes_and_ends():
    stopped = after(TICK, reason="no teammate was heard")
    other = after(stopped, 2, reason="not finite")
    assert told(None, stopped) == told(TICK, stopped) == told(stopped, other) == ["fault"]
    assert told(stopped, after(stopped, 2, reason="no teammate was heard")) == []
    assert told(other, after(other, 3)) == ["recovered"]


def test_misses_cuts_and_gaps_are_told_with_their_numbers():
    (event,) = changes(TICK, after(TICK, misses=3), 0)
    assert event.message == "3 deadlines missed"
    (event,) = changes(TICK, after(TICK, number=5), 0)
    assert event.message == "4 ticks were not recorded"
    (event,) = changes(None, after(TICK, number=0, steps=4, cut=True), 0)
    assert event.message == "the deadline cut the sample after 4 steps"
    cut = after(TICK, cut=True)
    assert told(cut, after(cut, 2, cut=True)) == []


def test_teammates_are_told_when_they_come_and_go():
    alone = after(TICK, mates=(2,))
    (event,) = changes(TICK, alone, 1_500_000_000_123_456_789)
    assert (event.name, event.message[:7]) == ("lost", "robot 1")
    assert (event.timestamp.sec, event.timestamp.nsec) == (1_500_000_000, 123_456_789)
    assert told(alone, after(TICK, number=2)) == ["found"]
