"""What times of arrival say: every lost tick is found, none is invented."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.control.rate import DeadlineGrid
from firmware_bridge.sil.judge.figures import (
    LoggedTicks,
    halts,
    miss_counts,
    missed_bursts,
    percentiles,
    pose_ages,
)

PERIOD = 0.02


@given(
    lost=st.sets(st.integers(1, 298)),
    phase=st.floats(0.0, 1.0),
    seed=st.integers(0, 2**16),
    late=st.floats(0.0, 0.6),
)
def test_misses_are_the_ticks_that_brought_nothing(lost, phase, seed, late):
    """A tenth of the commands is late, by less than what is left of their period."""
    draw = np.random.default_rng(seed)
    delay = draw.uniform(0.0, 0.1, 300) + late * (draw.random(300) < 0.1)
    ticks = [tick for tick in range(300) if tick not in lost]
    if len(ticks) < 60:
        return
    arrival = np.array([5.0 + PERIOD * (tick + phase + delay[tick]) for tick in ticks])
    begin = 5.0 + PERIOD * phase
    bursts = missed_bursts(arrival, PERIOD, begin, begin + 300 * PERIOD)
    assert bursts.sum() == pytest.approx(len(lost), abs=1)  # the window cuts its first or last tick
    runs, length = [], 0
    for tick in range(300):
        length = length + 1 if tick in lost else 0
        runs.append(length)
    assert abs(int(bursts.max(initial=0)) - max(runs)) <= 1


def test_silence_is_missed_from_beginning_to_end():
    assert missed_bursts(np.empty(0), PERIOD, 1.0, 3.0).tolist() == [100]
    arrival = 1.0 + PERIOD * (np.arange(50) + 0.5)
    assert missed_bursts(arrival, PERIOD, 1.0, 3.0).tolist() == [50]


class Loop:
    """A control loop on a busy machine, on `DeadlineGrid` with a clock of its own."""

    def __init__(self, seed, busy):
        self.draw, self.busy, self.now_s = np.random.default_rng(seed), busy, 3.7
        self.grid = DeadlineGrid(PERIOD, lambda: self.now_s, self.sleep)

    def sleep(self, seconds):
        self.now_s += seconds + self.late(0.1)

    def late(self, usual):
        """Usually a share of ``usual`` periods, now and then some whole ones."""
        return PERIOD * (
            self.draw.uniform(0.0, usual) + (self.draw.random() < self.busy) * self.draw.uniform(0, 4)
        )

    def run(self, ticks):
        due, decided, misses, arrival = [], [], [], []
        for _ in range(ticks):
            due.append(self.grid.wait())
            self.now_s += self.late(0.05)
            decided.append(self.now_s)
            misses.append(self.grid.misses)
            arrival.append(self.now_s + 1e-5)
        arrival, *logged = (np.array(column) for column in (arrival, due, decided, misses))
        return arrival, LoggedTicks(*logged)


@given(seed=st.integers(0, 2**16), busy=st.floats(0.0, 0.3), swallowed=st.sets(st.integers(50, 250)))
def test_both_ends_count_the_same_misses_unless_a_command_was_swallowed(seed, busy, swallowed):
    arrival, logged = Loop(seed, busy).run(300)
    arrived = np.delete(arrival, list(swallowed))
    counts = miss_counts(arrived, logged, PERIOD, arrival[10], arrival[290])
    assert counts.lacking == counts.counted + len(swallowed)
    assert counts.counted <= logged.misses[-1]


def test_where_the_log_is_silent_nothing_is_compared():
    arrival, logged = Loop(1, 0.0).run(100)
    window = (PERIOD, 0.0, 10.0)
    assert miss_counts(arrival, LoggedTicks(*(np.empty(0),) * 3), *window) is None
    assert miss_counts(np.empty(0), logged, *window) is None
    # Its logger died half-way: what came later is not held against the loop.
    assert miss_counts(arrival[:80], LoggedTicks(*(column[:40] for column in logged)), *window)[:2] == (0, 0)


def test_the_age_of_a_pose_is_counted_from_its_measurement():
    measured = np.array([0.0, 0.010, 0.020, 0.030])
    decided = np.array([0.0150, 0.0352])
    used = np.array([0.0103, 0.0301])  # stamped when they reached the guard
    arrival = np.array([0.0120, 0.0155, 0.0360])
    ages = pose_ages(arrival, decided, used, measured, 0.0)
    np.testing.assert_allclose(ages, [0.0055, 0.0060])  # what was decided before the log is left out


def test_a_stamp_rounded_down_still_means_its_pose():
    measured, used = np.array([1.000, 1.010]), np.array([1.0095])
    decided, arrival = np.array([1.012]), np.array([1.013])
    assert pose_ages(arrival, decided, used, measured, 0.002) == pytest.approx([0.003])
    assert pose_ages(arrival, decided, used, measured, 0.0) == pytest.approx([0.013])


def test_without_a_log_there_are_no_ages():
    assert percentiles(pose_ages(np.array([1.0]), np.empty(0), np.empty(0), np.array([0.5]), 0.0)) is None


def test_halts_are_times_without_a_command_to_move():
    arrival = PERIOD * np.arange(500)
    speed = np.ones(500)
    speed[100:250] = 0.0
    [(begin, end)] = halts(arrival, speed, PERIOD, 0.0, 10.0)
    assert (begin, end) == (pytest.approx(99 * PERIOD), pytest.approx(250 * PERIOD))


def test_percentiles_are_scaled():
    numbers = percentiles([0.001 * n for n in range(1001)], 1e3)
    assert (numbers.p50, numbers.p99, numbers.max) == pytest.approx((500.0, 990.0, 1000.0))


def test_a_late_command_is_not_lacking():
    """It came 0.9 periods late: missed in its own period, and no deadline of the loop's."""
    due = PERIOD * np.arange(100) + 1.0
    arrival = due + 0.1 * PERIOD
    arrival[[20, 50]] += 0.9 * PERIOD
    logged = LoggedTicks(due, arrival - 1e-4, np.zeros(100))
    assert miss_counts(arrival, logged, PERIOD, 0.0, 10.0) == (0, 0, 2)
    assert missed_bursts(arrival, PERIOD, 1.0, 3.0).sum() == 2
