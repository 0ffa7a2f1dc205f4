"""How late a sleeping process wakes here: ``python -m ...wake_probe FILE DURATION [realtime]``.

Sleeps on a grid like a control loop and does nothing else, with the same scheduling as the robots, once the
harness tells when the run begins; on SIGTERM it writes what it saw.
"""

import sys
import time
from pathlib import Path

import msgspec

from edge_runtime.common.realtime import enter_realtime
from edge_runtime.common.signals import StopSignals
from firmware_bridge.sil.measurement.samples import Samples

PERIOD_S = 0.005


class ProbeRecord(msgspec.Struct, frozen=True):
    """Wake-ups."""

    time_s: list[float]
    """When each was due."""
    late_s: list[float]


def main(arguments: list[str]) -> int:
    """Run as the harness's child."""
    due_s, late_s = (Samples(1.0 / PERIOD_S, float(arguments[1])) for _ in range(2))
    with StopSignals() as signals:
        if "realtime" in arguments[2:]:
            enter_realtime()
        sys.stdin.readline()
        due = time.monotonic()
        while not signals.reason:
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0.0))
            due_s.append(due)
            late_s.append(time.monotonic() - due)
    record = ProbeRecord(due_s.tolist(), late_s.tolist())
    Path(arguments[0]).write_bytes(msgspec.msgpack.encode(record))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
