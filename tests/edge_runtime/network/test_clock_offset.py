"""Ages against a simulation's truth: never too old, too young by the least delay and the drift."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.network.clock_offset import DRIFT, RemoteClock

delays = st.floats(0.0, 5.0)
messages = st.lists(st.tuples(st.floats(0.001, 10.0), delays, st.booleans()), min_size=1, max_size=60)
drifts = st.floats(-DRIFT, DRIFT)
offsets = st.floats(-1e6, 1e6)
ROUNDING = 1e-6


def received(messages):
    """True times of sending and arrival of what arrives in order: (gap, delay, lost) each."""
    sent, arrived, kept = 0.0, 0.0, []
    for gap, delay, lost in messages:
        sent += gap
        if not lost and sent + delay >= arrived:
            arrived = sent + delay
            kept.append((sent, arrived))
    return kept


@given(messages=messages, drift=drifts, offset=offsets, later=st.floats(0.0, 1.0))
def test_ages_bracket_the_truth(messages, drift, offset, later):
    """Our clock is true time; theirs is off by anything and runs at its own speed."""
    clock, seen = RemoteClock(), []
    for sent, arrived in received(messages):
        stamp = offset + (1.0 + drift) * sent
        clock.heard(stamp, arrived)
        seen.append((sent, arrived))
        age, truth = arrived + later - clock.local_s(stamp), arrived + later - sent
        assert age <= truth + ROUNDING
        least = min(a - s + 2.0 * DRIFT * (arrived - s) for s, a in seen)
        assert age >= truth - least - ROUNDING
        assert age >= later - ROUNDING


@given(messages=messages, offset=offsets)
def test_ages_do_not_depend_on_the_offset(messages, offset):
    plain, shifted = RemoteClock(), RemoteClock()
    for sent, arrived in received(messages):
        plain.heard(sent, arrived)
        shifted.heard(sent + offset, arrived)
        assert shifted.local_s(sent + offset) == pytest.approx(plain.local_s(sent), abs=ROUNDING)


@pytest.mark.parametrize("jump", [-3600.0, -0.01, 3600.0])
def test_a_jump_of_their_clock_is_forgiven_at_once(jump):
    clock = RemoteClock()
    for tick in range(100):
        now, offset = 0.02 * tick, jump if tick >= 50 else 0.0
        clock.heard(now + offset, now + 0.001)
        assert now + 0.001 - clock.local_s(now + offset) <= 0.02


def test_messages_that_wait_grow_old():
    clock = RemoteClock()
    for tick in range(100):
        clock.heard(0.02 * tick, 0.02 * tick + 0.001)
    for tick in range(100, 200):  # a queue has formed on the way
        arrival = 0.02 * tick + 0.5
        clock.heard(0.02 * tick, arrival)
        assert arrival - clock.local_s(0.02 * tick) == pytest.approx(0.499, abs=2e-3)


def test_a_repeated_measurement_grows_old():
    clock = RemoteClock()
    for tick in range(10):
        clock.heard(5.0, 0.02 * tick)
        assert 0.02 * tick - clock.local_s(5.0) == pytest.approx(0.02 * tick, abs=1e-3)
