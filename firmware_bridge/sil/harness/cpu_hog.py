"""``python -m firmware_bridge.sil.harness.cpu_hog AT_S FOR_S``: computes without end for a while."""

import sys
import time

from firmware_bridge.sil.scenario.start_gate import await_start, sleep_until


def main(arguments: list[str]) -> int:
    """Run as the harness's child."""
    at_s, for_s = map(float, arguments)
    t0_s = await_start()
    sleep_until(t0_s + at_s)
    while time.monotonic() < t0_s + at_s + for_s:
        sum(range(10_000))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
