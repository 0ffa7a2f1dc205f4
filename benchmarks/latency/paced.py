"""The tick in a real loop that sleeps between deadlines, in a process of its own for each variant.

Sleeping lets the clock drop and the caches empty, so a paced tick takes longer than one of many.
``python -m benchmarks.latency.paced JSON`` is one variant's process.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import product

import msgspec
import numpy as np

from benchmarks.latency.cases import DEFAULT, Case, workload
from benchmarks.latency.contenders import CONTENDERS
from benchmarks.latency.measure import Slot, Timing
from benchmarks.latency.rows import LatencyRow, make_row
from edge_runtime.common.realtime import enter_realtime, freeze_garbage
from edge_runtime.control.start import StateGrid, lead_for

WARM_UP = 10
"""Ticks that are not measured."""


class Variant(msgspec.Struct, frozen=True):
    """One paced loop."""

    backend: str
    paced_hz: float
    realtime: bool
    early_wake: bool
    duration_s: float
    case: Case = DEFAULT


def variants(backends: list[str], duration_s: float) -> Iterator[Variant]:
    """Every rate, with and without real-time scheduling, and real-time with an early wake."""
    ways = [(False, False), (True, False), (True, True)]
    for backend, rate, (realtime, early) in product(backends, (50.0, 100.0, 200.0), ways):
        yield Variant(backend, rate, realtime, early, duration_s)


def measure(variant: Variant) -> LatencyRow | str:
    """Run one variant in a process of its own; returns why where the system refuses it."""
    command = [sys.executable, "-m", "benchmarks.latency.paced", msgspec.json.encode(variant).decode()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    ticks = np.array(json.loads(done.stdout))
    timing = Timing(tuple(Slot(slot, slot) for slot in np.array_split(ticks, max(1, len(ticks) // 50))))
    paced = {name: getattr(variant, name) for name in ("paced_hz", "realtime", "early_wake")}
    return make_row(variant.backend, variant.case, timing, **paced)


def run(variant: Variant) -> list[float]:
    """Drive the loop in this process and return each tick's wall time in microseconds."""
    tick = CONTENDERS[variant.backend](workload(variant.case))
    period = 1.0 / variant.paced_hz
    tick()
    lead = lead_for(tick, period) if variant.early_wake else 0.0
    grid, durations = StateGrid(period, None, tick, lead), []
    freeze_garbage()
    if variant.realtime:
        enter_realtime()
    for _ in range(WARM_UP + max(1, round(variant.duration_s / period))):
        grid.wait()
        begin = time.perf_counter()
        tick()
        durations.append(1e6 * (time.perf_counter() - begin))
    return durations[WARM_UP:]


if __name__ == "__main__":
    print(json.dumps(run(msgspec.json.decode(sys.argv[1], type=Variant))))
