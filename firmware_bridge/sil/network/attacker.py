"""``python -m firmware_bridge.sil.network.attacker SPEC``: a peer without the key talks to every robot.

It knows the layout of the frames and makes good ones, under a key of its own; it sends them as they are, cut,
altered, as noise, and again and again. What it sends goes to the robots' own ports.
"""

import itertools
import random
import secrets
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from edge_runtime.messages import RobotState
from edge_runtime.network.seal import MAGIC_BYTES, Magic
from edge_runtime.network.team_wire import FRAME_BYTES, Frame, encode
from firmware_bridge.sil.scenario.faults import Hostile
from firmware_bridge.sil.scenario.ports import HOST
from firmware_bridge.sil.scenario.start_gate import await_start, sleep_until

BURST_S = 0.005
"""Frames go out in bursts this far apart: sleeping for each would cost more than the frames."""


class HostileSpec(msgspec.Struct, frozen=True):
    """What the process is started with."""

    ports: dict[int, int]
    """Of the robots, by id."""
    fault: Hostile


class Forger:
    """Knows everything but the key.

    Args:
        robots: ids of the team.
        draw: where its whims come from.
    """

    def __init__(self, robots: tuple[int, ...], draw: random.Random) -> None:
        self._robots, self._draw, self._key = robots, draw, secrets.token_bytes(32)
        self._sequence = 0

    def forge(self, receiver: int) -> bytes:
        """Return a packet that must be refused."""
        kinds = (self._foreign, self._altered, self._cut, self._noise)
        return self._draw.choice(kinds)(receiver)

    def _foreign(self, receiver: int) -> bytes:
        """A frame in perfect order, of a robot of the team that stands where the receiver wants to go."""
        self._sequence += 1
        sender = self._draw.choice([robot for robot in self._robots if robot != receiver] or [receiver])
        state = RobotState(sender, time.monotonic(), (self._draw.uniform(-1, 1), 0.0), (0.0, 0.0))
        boot_id, challenge, answer = (self._draw.getrandbits(64) for _ in range(3))
        return encode(
            Frame(receiver, boot_id, self._sequence, challenge, answer, state, (0.0, 0.0)), self._key
        )

    def _altered(self, receiver: int) -> bytes:
        packet = bytearray(self._foreign(receiver))
        packet[self._draw.randrange(len(packet))] ^= 1 << self._draw.randrange(8)
        return bytes(packet)

    def _cut(self, receiver: int) -> bytes:
        return self._foreign(receiver)[: self._draw.randrange(FRAME_BYTES)]

    def _noise(self, receiver: int) -> bytes:  # noqa: ARG002 - one signature for all kinds
        return Magic.TEAM + self._draw.randbytes(FRAME_BYTES - MAGIC_BYTES)


def bursts(fault: Hostile) -> Iterator[tuple[float, int]]:
    """Yield (time in s, frames to have been sent by then), evenly over the fault's time."""
    count = max(1, round(fault.for_s / BURST_S))
    for index in range(count):
        yield fault.at_s + index * BURST_S, round(fault.frames * (index + 1) / count)


def main(arguments: list[str]) -> int:
    """Run as the harness's child."""
    spec = msgspec.json.decode(Path(arguments[0]).read_bytes(), type=HostileSpec)
    forger = Forger(tuple(spec.ports), random.Random(0))
    turn = itertools.cycle(spec.ports.items())
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    t0_s, sent = await_start(), 0
    for time_s, until in bursts(spec.fault):
        sleep_until(t0_s + time_s)
        for _ in range(sent, until):
            robot_id, port = next(turn)
            one.sendto(forger.forge(robot_id), (HOST, port))
        sent = until
    print(f"sent {sent} frames", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
