"""``python -m benchmarks.faults.runtime SPEC COMMANDS REALTIME``: drives as ``edge-run`` does, at 50 Hz.

Prints the guard's process number, and after COMMANDS to a robot that drives the monotonic time of each call
that sent one.
"""

import sys
import time

import msgspec

from benchmarks.faults.robot import PERIOD_S, SPEED_M_S
from edge_runtime.common.realtime import enter_realtime
from edge_runtime.messages import Command
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.guard.wire import Phase


def drive(bridge: GuardedBridge, commands: int) -> list[float]:
    """Command on a grid of deadlines until so many went to a robot that drives; returns when each went."""
    sent: list[float] = []
    due_s = time.monotonic()
    while commands > 0:
        due_s += PERIOD_S
        time.sleep(max(due_s - time.monotonic(), 0.0))
        bridge.read()
        now_s = time.monotonic()
        bridge.write(Command(0, len(sent), now_s, (1.0, 0.0), (SPEED_M_S, 0.0)))
        sent.append(now_s)
        commands -= bridge.phase is Phase.DRIVING
    return sent


def main() -> None:
    """Drive one robot."""
    spec = msgspec.json.decode(sys.argv[1], type=GuardSpec)
    if int(sys.argv[3]):
        enter_realtime()  # As ``edge-run --realtime``: the guard inherits it.
    with GuardedBridge(spec) as bridge:
        print(bridge.guard_pid, flush=True)
        sent = drive(bridge, int(sys.argv[2]))
    print(msgspec.json.encode(sent).decode(), flush=True)


if __name__ == "__main__":
    main()
