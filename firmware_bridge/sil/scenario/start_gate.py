"""What the harness's helper processes share: they wait for the run's beginning, then act on its clock."""

import sys
import time

import msgspec


class RunStart(msgspec.Struct, frozen=True):
    """When a run begins, as the world's process tells the harness and that tells its helpers."""

    t0_s: float
    """Monotonic time at which the measurement begins and the faults' timeline starts."""


def await_start() -> float:
    """Block until the harness tells when the run begins; ends the process if it never will."""
    line = sys.stdin.readline()
    if not line:
        sys.exit(0)
    return msgspec.json.decode(line, type=RunStart).t0_s


def sleep_until(time_s: float) -> None:
    """Sleep until a monotonic time; one that has passed does not even yield the processor."""
    wait_s = time_s - time.monotonic()
    if wait_s > 0.0:
        time.sleep(wait_s)
