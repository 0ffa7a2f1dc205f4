"""Unsigned, replayed and altered MAVLink frames against a link that asks for signatures."""

import random
import secrets
import select
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from pymavlink.dialects.v20 import common

from benchmarks.faults.opened import opened_link
from benchmarks.faults.robot import MavlinkRobot
from edge_runtime.errors import BridgeError
from firmware_bridge.mavlink.link import MavlinkLink
from firmware_bridge.mavlink.signing import clock_ticks
from firmware_bridge.sil.firmware.autopilot import Autopilot

CHUNK = 30
"""Frames between two looks at the link: they fit into a socket's buffer and into one of its passes."""

ARRIVING_S = 1.0
"""Longest wait for the first of them."""


def count_accepted(frames: int, advance: Callable[[int], None], seed: int = 0) -> int:
    """Count the forged frames that the link took for genuine.

    Raises:
        BridgeError: if it refuses genuine frames as well, which would prove nothing.
    """
    accepted = 0
    with tempfile.TemporaryDirectory() as folder:
        key = Path(folder) / "key"
        key.touch(mode=0o600)
        key.write_bytes(secrets.token_bytes(32))
        with MavlinkRobot(key) as rover, opened_link(rover) as link:
            assert isinstance(link, MavlinkLink)  # noqa: S101 - for the type checker
            forger = Forger(rover, random.Random(seed))
            for _ in range(0, frames, CHUNK):
                genuine = forger.genuine()
                if _accepted(link, rover, [genuine]) != 1:
                    raise BridgeError("a genuine frame was refused")
                forger.recorded.append(genuine)
                accepted += _accepted(link, rover, [forger.forge() for _ in range(CHUNK)])
                advance(CHUNK)
    return accepted


def _accepted(link: MavlinkLink, rover: MavlinkRobot, frames: list[bytes]) -> int:
    """Send frames and count those that the link accepts."""
    link.receive(time.monotonic())
    before = link.tally.accepted
    for frame in frames:
        rover.wire.send(frame)
    select.select(link.filenos(), (), (), ARRIVING_S)
    link.receive(time.monotonic())
    return link.tally.accepted - before


class Forger:
    """Knows no key, has listened for a while, and is good at checksums."""

    def __init__(self, rover: MavlinkRobot, draw: random.Random) -> None:
        self.recorded: deque[bytes] = deque(maxlen=1000)
        """Genuine frames that the link has accepted before."""
        self._rover = rover
        self._draw = draw
        self._unsigned = Autopilot(rover.firmware.profile)
        self._impostor = Autopilot(rover.firmware.profile)
        self._impostor.sign(secrets.token_bytes(32), clock_ticks())

    def genuine(self) -> bytes:
        """Return a frame that the rover signs now."""
        return self._rover.firmware.pack(self._message())

    def forge(self) -> bytes:
        """Return a frame that must be refused."""
        forgeries = (
            self._without_signature,
            self._recorded,
            self._with_a_flipped_bit,
            self._with_a_wrong_key,
        )
        return self._draw.choice(forgeries)()

    def _without_signature(self) -> bytes:
        return self._unsigned.pack(self._message())

    def _recorded(self) -> bytes:
        return self._draw.choice(self.recorded)

    def _with_a_flipped_bit(self) -> bytes:
        frame = bytearray(self.genuine())
        frame[self._draw.randrange(1, len(frame))] ^= 1 << self._draw.randrange(8)
        return bytes(frame)

    def _with_a_wrong_key(self) -> bytes:
        return self._impostor.pack(self._message())

    def _message(self) -> common.MAVLink_message:
        """Return what would do harm: another mode, or a position far away."""
        if self._draw.random() < 0.5:
            return common.MAVLink_heartbeat_message(10, 3, 0x81, 4, 4, 3)
        return common.MAVLink_local_position_ned_message(
            self._draw.getrandbits(32), *(self._draw.uniform(-1e3, 1e3) for _ in range(6))
        )
