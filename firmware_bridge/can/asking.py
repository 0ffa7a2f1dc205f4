"""One question to a drive on an open bus, before the guard's loop begins."""

import select
import time
from collections.abc import Callable
from typing import TypeVar

from edge_runtime.errors import BridgeError
from firmware_bridge.can.frame import Frame, Transport

ANSWER_S = 0.2
TRIES = 3

T = TypeVar("T")


def ask(transport: Transport, question: Frame, understand: Callable[[Frame], T | None], who: str) -> T:
    """Send a frame until ``understand`` makes something of one that arrives, and return that.

    Raises:
        BridgeError: if nothing does; ``who`` is the drive's name.
    """
    for _ in range(TRIES):
        transport.send(question)
        end_s = time.monotonic() + ANSWER_S
        while (wait_s := end_s - time.monotonic()) > 0.0:
            select.select((transport.fileno(),), (), (), wait_s)
            for frame in transport.receive():
                answer = understand(frame)
                if answer is not None:
                    return answer
    raise BridgeError(f"{who} does not answer: check power, wiring, bit rate and the profile's numbers of it")
