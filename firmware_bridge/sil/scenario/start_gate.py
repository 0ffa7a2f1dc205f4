"""What the harness's helper processes share: they wait for the run's beginning, then act on its clock."""

import sys
import time

import msgspec

from firmware_bridge.sil.firmware.world_process import FieldStart


def await_start() -> float:
    """Block until the harness tells when the run begins; ends the process if it never will."""
    line = sys.stdin.readline()
    if not line:
        sys.exit(0)
    return msgspec.json.decode(line, type=FieldStart).t0_s


def sleep_until(time_s: float) -> None:
    """Sleep until a monotonic time; one that has passed does not even yield the processor."""
    wait_s = time_s - time.monotonic()
    if wait_s > 0.0:
        time.sleep(wait_s)
