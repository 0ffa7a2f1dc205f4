"""What the numbers were measured on, and whether it was quiet enough to believe them."""

import os
import platform
import time
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.latency.measure import Timing, stolen_share
from edge_runtime.common.processor import processor


class Machine(msgspec.Struct, frozen=True):
    """The processor and system of a run."""

    processor: str
    cores: int
    governor: str
    kernel: str
    wake_us: tuple[float, float, float]
    """Lateness of a sleep of 5 ms: p50, p99, p99.9."""
    python: str
    numpy: str
    engine: str
    """The instruction set of the compiled kernel; empty without one."""


STOLEN_ALLOWED = 0.03
CLOCK_SPREAD_ALLOWED = 1.25
WAKE_P99_ALLOWED_US = 2000.0


def describe(engine: str, wakes: int = 400) -> Machine:
    """Look the machine up and measure its wake-ups."""
    return Machine(
        processor=processor(),
        cores=len(os.sched_getaffinity(0)),
        governor=_read(Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")) or "not visible",
        kernel=platform.release(),
        python=platform.python_version(),
        numpy=np.__version__,
        engine=engine,
        wake_us=_wake_latency(wakes),
    )


def noise(timings: Mapping[str, Timing]) -> list[str]:
    """Why a run must not be believed; empty for a quiet machine. ``timings`` holds the probe ``peak``."""
    reasons = []
    stolen = stolen_share(timings)
    if stolen > STOLEN_ALLOWED:
        reasons.append(f"other processes took {stolen:.0%} of the time, {STOLEN_ALLOWED:.0%} allowed")
    fastest = [slot.cpu.min() for slot in timings["peak"].slots]
    spread = max(fastest) / min(fastest)
    if spread > CLOCK_SPREAD_ALLOWED:
        reasons.append(f"the core's speed changed {spread:.2f} times, {CLOCK_SPREAD_ALLOWED:g} allowed")
    return reasons


def wake_noise(machine: Machine) -> list[str]:
    """Why the loop's timings, which depend on wake-ups, must not be believed; empty for a quiet machine."""
    p99 = machine.wake_us[1]
    if p99 <= WAKE_P99_ALLOWED_US:
        return []
    return [f"sleeps ended {p99:.0f} us late at p99, {WAKE_P99_ALLOWED_US:.0f} allowed"]


def _wake_latency(count: int, period_s: float = 0.005) -> tuple[float, float, float]:
    late = []
    for _ in range(count):
        due = time.monotonic() + period_s
        time.sleep(period_s)
        late.append(1e6 * (time.monotonic() - due))
    p50, p99, p99_9 = np.percentile(late, [50.0, 99.0, 99.9]).tolist()
    return p50, p99, p99_9


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
