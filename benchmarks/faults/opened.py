"""A link in this process, opened on a real wire to a firmware that takes commands."""

import contextlib
import threading
import time
from collections.abc import Iterator

import msgspec

from benchmarks.faults.robot import PERIOD_S, SPEED_M_S, Robot
from edge_runtime.errors import BridgeError
from firmware_bridge.guard.core import Guard
from firmware_bridge.guard.link import Link, Setpoint
from firmware_bridge.guard.process import make_link
from firmware_bridge.guard.wire import Phase, encode_command

ENABLING_S = 10.0
FORWARD = ((1.0, 0.0), (SPEED_M_S, 0.0))
"""Action and velocity of a command that is in order."""


@contextlib.contextmanager
def opened_link(robot: Robot) -> Iterator[Link]:
    """Open the robot's link while its firmware answers; close it at the end."""
    link = make_link(robot.spec())
    opened = threading.Event()
    serving = threading.Thread(target=robot.serve, args=(ENABLING_S, opened.is_set))
    serving.start()
    try:
        link.open()
    finally:
        opened.set()
        serving.join()
    with contextlib.closing(link):
        yield link


def enable(link: Link, robot: Robot) -> None:
    """Bring the robot to take commands.

    Raises:
        BridgeError: if it does not.
    """
    guard = Guard(link, msgspec.structs.replace(robot.spec(), deadline_s=ENABLING_S))
    for sequence in range(round(ENABLING_S / PERIOD_S)):
        now_s = time.monotonic()
        guard.on_packet(encode_command(Setpoint(sequence, now_s, *FORWARD)), now_s)
        if guard.phase is Phase.DRIVING:
            return
        robot.serve(PERIOD_S)
        guard.on_feedback(time.monotonic())
        guard.on_time(time.monotonic())
    raise BridgeError(f"the {robot.name} robot was never enabled")
