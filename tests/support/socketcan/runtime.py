"""A runtime that commands 0.5 m/s at 50 Hz until the guard refuses or SIGINT comes; argument: a GuardSpec."""

import contextlib
import sys
import time

import msgspec

from edge_runtime.errors import BridgeError
from edge_runtime.messages import Command
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.spec import GuardSpec


def drive(bridge: GuardedBridge) -> None:
    """Command until something ends it."""
    for sequence in range(1_000_000):
        bridge.read()
        bridge.write(Command(3, sequence, time.monotonic(), (0.0, 0.0), (0.5, 0.0)))
        time.sleep(0.02)


def main() -> None:
    """Print the guard's process number; at the end the time, the dropped frames and the reason."""
    with GuardedBridge(msgspec.json.decode(sys.argv[1], type=GuardSpec)) as bridge:
        print(bridge.guard_pid, flush=True)
        reason = "interrupted"
        with contextlib.suppress(KeyboardInterrupt):
            try:
                drive(bridge)
            except BridgeError as error:
                reason = str(error)
        print(time.monotonic(), bridge.counts.dropped, reason, flush=True)


if __name__ == "__main__":
    main()
