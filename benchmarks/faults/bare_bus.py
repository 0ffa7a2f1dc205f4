"""``python -m benchmarks.faults.bare_bus SPEC COMMANDS REALTIME``: one frame at 50 Hz, without a guard.

Prints the monotonic time of each call that sent it.
"""

import sys
import time
from collections.abc import Callable

import msgspec

from benchmarks.faults.robot import PERIOD_S, SPEED_M_S, driving_frame
from edge_runtime.common.realtime import enter_realtime
from firmware_bridge.can.bus import CanBus
from firmware_bridge.can.link import CanOptions
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.mavlink.encoder import Encoder
from firmware_bridge.mavlink.messages import Target
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import BODY_NED, VELOCITY_AND_YAW_RATE
from firmware_bridge.mavlink.transport import open_transport


def open_sender(spec: GuardSpec) -> Callable[[], bool]:
    """Open the bus that a guard would own; returns what puts SPEED_M_S on it."""
    if spec.link == "can":
        bus = CanBus(msgspec.json.decode(spec.options, type=CanOptions).bus)
        bus.open()
        return lambda: bus.send(driving_frame())
    options = msgspec.json.decode(spec.options, type=MavlinkOptions)
    transport = open_transport(options.address)
    target = Target(BODY_NED, VELOCITY_AND_YAW_RATE, velocity_m_s=(SPEED_M_S, 0.0, 0.0))
    frame = Encoder(options.source_system, (options.system_id, 1)).encode(target, time.monotonic())
    return lambda: transport.send(frame)


def main() -> None:
    """Send on a grid of deadlines."""
    send = open_sender(msgspec.json.decode(sys.argv[1], type=GuardSpec))
    if int(sys.argv[3]):
        enter_realtime()
    sent = []
    due_s = time.monotonic()
    for _ in range(int(sys.argv[2])):
        due_s += PERIOD_S
        time.sleep(max(due_s - time.monotonic(), 0.0))
        sent.append(time.monotonic())
        send()
    print(msgspec.json.encode(sent).decode(), flush=True)


if __name__ == "__main__":
    main()
