"""Interleaved timing: every contender in every round, so that a slow minute is slow for all of them."""

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Slot:
    """The ticks of one contender in one round, in microseconds."""

    wall: np.ndarray
    cpu: np.ndarray
    """The processor time of the same ticks: less than wall time where other processes came between."""


@dataclass(frozen=True)
class Timing:
    """All ticks of one contender."""

    slots: tuple[Slot, ...]
    """One a round."""

    @property
    def median_us(self) -> float:
        """Median of all ticks."""
        return self.percentile_us(50.0)

    @property
    def best_us(self) -> float:
        """Median of the best round: what the machine does when nothing disturbs it."""
        return min(float(np.median(slot.wall)) for slot in self.slots)

    def percentile_us(self, percent: float) -> float:
        """A percentile of all ticks."""
        return float(np.percentile(np.concatenate([slot.wall for slot in self.slots]), percent))

    def times_faster_than(self, other: "Timing") -> float:
        """How many of this one's ticks fit into one of the other's: the median over the rounds.

        In processor time, so that what other processes take does not count against the longer tick.
        """
        medians = [[np.median(slot.cpu) for slot in timing.slots] for timing in (other, self)]
        return float(np.median(np.divide(*medians)))


def interleave(
    ticks: Mapping[str, Callable[[], object]], rounds: int, slot_s: float, seed: int = 0
) -> dict[str, Timing]:
    """Time every function for about ``slot_s`` in each of ``rounds`` rounds, in a new order each round."""
    order, names = np.random.default_rng(seed), list(ticks)
    kept: dict[str, list[Slot]] = {name: [] for name in names}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for index in order.permutation(len(names)):
                kept[names[index]].append(_slot(ticks[names[index]], slot_s))
    finally:
        gc.enable()
    return {name: Timing(tuple(slots)) for name, slots in kept.items()}


def stolen_share(timings: Mapping[str, Timing]) -> float:
    """Share of the wall time in which other processes ran instead."""
    slots = [slot for timing in timings.values() for slot in timing.slots]
    return 1.0 - sum(slot.cpu.sum() for slot in slots) / sum(slot.wall.sum() for slot in slots)


def _slot(tick: Callable[[], object], slot_s: float) -> Slot:
    """Ticks for ``slot_s``; those of a first tenth refill the caches and do not count."""
    end = time.perf_counter() + 0.1 * slot_s
    tick()
    while time.perf_counter() < end:
        tick()
    end, durations = time.perf_counter() + slot_s, []
    while True:
        cpu = time.thread_time_ns()
        begin = time.perf_counter()
        tick()
        now = time.perf_counter()
        durations.append((1e6 * (now - begin), 1e-3 * (time.thread_time_ns() - cpu)))
        if now >= end:
            wall, used = np.array(durations).T
            return Slot(wall, used)
