"""One tick number for all: whatever the phases of the robots' grids, and whatever is lost between them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.team.tick import TeamTick

PERIOD_S = 0.02
shares = st.floats(0.0, 1.0, exclude_max=True)


def test_a_robot_alone_counts_its_periods_and_those_that_it_slept_through():
    tick = TeamTick(PERIOD_S)
    numbers = []
    for now in (5.0, 5.021, 5.045, 5.06, 5.2):
        tick.advance(now)
        numbers.append(tick.number)
    assert numbers == [0, 1, 2, 3, 10]


@settings(deadline=None)
@given(
    phases=st.lists(shares, min_size=2, max_size=5),
    starts=st.lists(st.integers(0, 50), min_size=5),
    seed=st.randoms(),
)
def test_all_agree_within_a_period_though_frames_are_lost(phases, starts, seed):
    """Robots join at different times; each hears each other one with a chance of a half."""
    ticks = [TeamTick(PERIOD_S) for _ in phases]
    first = {}
    for period in range(200):
        for robot in sorted(range(len(ticks)), key=phases.__getitem__):
            if period < starts[robot]:
                continue
            now_s = (period + phases[robot]) * PERIOD_S
            ticks[robot].advance(now_s)
            for other in range(len(ticks)):
                if other != robot and period > starts[other] and seed.random() < 0.5:
                    ticks[robot].heard(ticks[other].number)
            if period > 150:
                earliest = first.setdefault(ticks[robot].number, now_s)
                assert now_s - earliest <= PERIOD_S * (1 + 1e-9)


def test_a_number_never_goes_back():
    tick = TeamTick(PERIOD_S)
    tick.advance(0.0)
    tick.heard(1000)
    tick.heard(7)
    assert tick.number == 1000
    tick.advance(PERIOD_S)
    assert tick.number == 1001
    tick.advance(-3.0)
    assert tick.number == 1001


def test_a_faster_clock_leads():
    fast, slow = TeamTick(PERIOD_S), TeamTick(PERIOD_S)
    for step in range(1000):
        fast.advance(1.01 * PERIOD_S * step)
        slow.advance(PERIOD_S * step)
        slow.heard(fast.number)
    assert slow.number == fast.number == pytest.approx(1009, abs=1)
