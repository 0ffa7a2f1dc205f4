"""One tick number for all: whatever the phases of the robots' grids, and whatever is lost between them."""

import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.team.tick import LEAP, LEAP_S, TeamTick

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
                    ticks[robot].hear(other, ticks[other].number, now_s)
            if period > 150:
                earliest = first.setdefault(ticks[robot].number, now_s)
                assert now_s - earliest <= PERIOD_S * (1 + 1e-9)


def test_a_number_never_goes_back():
    tick = TeamTick(PERIOD_S)
    tick.advance(0.0)
    tick.hear(1, 1000, 0.0)
    tick.hear(1, 7, 0.0)
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
        slow.hear(1, fast.number, PERIOD_S * step)
    assert slow.number == fast.number == pytest.approx(1009, abs=1)


def fate(tick, robot_id, number, now_s):
    try:
        tick.hear(robot_id, number, now_s)
    except FrameError as error:
        return error.cause
    return None


def test_who_has_driven_alone_for_a_year_is_joined():
    tick = TeamTick(PERIOD_S)
    tick.advance(0.0)
    assert fate(tick, 1, 50 * 86_400 * 365, 0.0) is None
    assert tick.number == 50 * 86_400 * 365


@pytest.mark.parametrize("number", [2**53, LEAP + 1, 2**64 - 1])
def test_a_number_that_nobody_counts_to_is_not_adopted(number):
    tick = TeamTick(PERIOD_S)
    tick.advance(0.0)
    assert fate(tick, 1, number, 0.0) is Refusal.TICK_LEAPS
    assert tick.number == 0


def test_who_leaps_on_and_on_is_kept_out():
    tick, fates = TeamTick(PERIOD_S), []
    for step in range(1000):
        tick.advance(PERIOD_S * step)
        fates.append(fate(tick, 1, tick.number + LEAP, PERIOD_S * step))
    assert set(fates) == {Refusal.TICK_LEAPS, None}
    assert fates.count(None) == 1000 * PERIOD_S / LEAP_S
    assert tick.number < 2**62 * 1e-6


def test_who_starts_late_comes_after_a_team_that_has_leaped():
    tick, fates, steps = TeamTick(PERIOD_S), [], 300
    for step in range(steps):
        tick.advance(PERIOD_S * step)
        fates.append(fate(tick, 1, 5 * LEAP + step, PERIOD_S * step))
    assert fates[-1] is None
    assert tick.number == 5 * LEAP + steps - 1
    assert fates.index(None) * PERIOD_S == pytest.approx(4 * LEAP_S, abs=PERIOD_S)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 2**32))
@example(seed=38738)  # two leaps on one robot, before another one may follow the first
def test_robots_in_order_agree_whatever_one_among_them_says(seed):
    """It tells each of them something else, as often as it likes; they never keep each other out for long."""
    draw, ticks = random.Random(seed), {name: TeamTick(PERIOD_S) for name in "abc"}
    for period in range(600):
        now_s = period * PERIOD_S
        for tick in ticks.values():
            tick.advance(now_s)
        if period < 400 and draw.random() < 0.3:
            victim = draw.choice(list(ticks.values()))
            fate(victim, "liar", victim.number + draw.choice([5000, LEAP, 2**53, 2**60]), now_s)
        kept_out = [
            fate(ticks[one], other, ticks[other].number, now_s)
            for one in ticks
            for other in ticks
            if one != other
        ]
    assert kept_out == [None] * 6
    numbers = [tick.number for tick in ticks.values()]
    assert max(numbers) - min(numbers) <= 1
