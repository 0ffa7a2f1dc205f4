import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.mavlink.clock import REMEMBERED, Clock
from firmware_bridge.mavlink.messages import TimeSync

OFFSET_S = 37.25
"""How far our clock is ahead of the autopilot's."""


def exchange(clock, sent_s, out_s, back_s):
    asked = clock.request(sent_s)
    remote_ns = round((sent_s + out_s - OFFSET_S) * 1e9)
    clock.on_answer(TimeSync(remote_ns, asked.asker_ns), sent_s + out_s + back_s)


def test_nothing_is_known_before_the_first_answer():
    assert Clock().local_s(1.0) is None


def test_an_even_round_trip_gives_the_exact_offset():
    clock = Clock()
    exchange(clock, 100.0, 0.004, 0.004)
    assert clock.local_s(5.0) == pytest.approx(5.0 + OFFSET_S, abs=1e-8)


@given(st.lists(st.tuples(st.floats(0.0, 0.4), st.floats(0.0, 0.4)), min_size=1, max_size=REMEMBERED))
def test_the_error_is_at_most_half_the_smallest_round_trip(delays):
    clock = Clock()
    for index, (out_s, back_s) in enumerate(delays):
        exchange(clock, 100.0 + index, out_s, back_s)
    smallest = min(out_s + back_s for out_s, back_s in delays)
    assert abs(clock.local_s(5.0) - 5.0 - OFFSET_S) <= smallest / 2 + 1e-8


def test_an_old_lucky_exchange_gives_way_to_newer_ones():
    clock = Clock()
    exchange(clock, 0.0, 0.0, 0.0)
    for index in range(REMEMBERED):
        exchange(clock, 1.0 + index, 0.1, 0.0)
    assert clock.local_s(0.0) == pytest.approx(OFFSET_S - 0.05, abs=1e-8)


@pytest.mark.parametrize(
    ("remote_ns", "asker_s", "now_s"),
    [(0, 1.0, 1.1), (5, 2.0, 1.0), (5, 1.0, 2.5)],
    ids=["a request", "an answer from the future", "an answer after a second"],
)
def test_what_is_no_answer_of_ours_is_passed_over(remote_ns, asker_s, now_s):
    clock = Clock()
    clock.on_answer(TimeSync(remote_ns, round(asker_s * 1e9)), now_s)
    assert clock.local_s(0.0) is None
