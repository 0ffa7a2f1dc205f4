"""Random commands that are not finite or over the limits, each to a guard that is driving."""

import time
from collections.abc import Callable

import msgspec
import numpy as np

from benchmarks.faults.opened import FORWARD, enable, opened_link
from benchmarks.faults.robot import Robot
from firmware_bridge.guard.core import Guard
from firmware_bridge.guard.link import Link, Setpoint, SetpointLimits
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.guard.wire import encode_command, encode_stop

CHUNK = 40
"""Commands between two looks at the wire: what they cause fits into a socket's buffer."""


def count_passed(robot: Robot, commands: int, advance: Callable[[int], None], seed: int = 0) -> int:
    """Count what bad commands put on the wire other than a plain stop would."""
    draw = np.random.default_rng(seed)
    passed = 0
    spec = msgspec.structs.replace(robot.spec(), arm=False)
    with opened_link(robot) as link:
        enable(link, robot)
        now_s = time.monotonic()
        # Twice, because an autopilot's first setpoint continues the motion of the enabling.
        for _ in range(2):
            robot.take_commands()
            _command_and_then(link, spec, encode_stop("reference", now_s), now_s)
        allowed = set(robot.take_commands())
        for _ in range(0, commands, CHUNK):
            for bad in bad_numbers(draw, CHUNK, spec.limits):
                setpoint = Setpoint(1, now_s, (bad[0], bad[1]), (bad[2], bad[3]))
                _command_and_then(link, spec, encode_command(setpoint), now_s)
            passed += sum(command not in allowed for command in robot.take_commands())
            advance(CHUNK)
    return passed


def _command_and_then(link: Link, spec: GuardSpec, packet: bytes, now_s: float) -> None:
    """Let a new guard, of a robot that already takes commands, forward a good command and get this packet."""
    guard = Guard(link, spec)
    guard.on_packet(encode_command(Setpoint(0, now_s, *FORWARD)), now_s)
    guard.on_packet(packet, now_s)


def bad_numbers(draw: np.random.Generator, count: int, limits: SetpointLimits) -> list[list[float]]:
    """Draw actions and velocities of which at least one number is not finite or over its limit.

    A third are random bits, a third are just or far over a limit, a third have one number that is none.
    """
    largest = np.array([*limits.high, limits.speed_m_s, limits.speed_m_s])
    numbers = draw.uniform(-0.5, 0.5, (count, 4)) * largest
    kinds, columns = draw.integers(3, size=count), draw.integers(4, size=count)
    bits = kinds == 0
    numbers[bits] = np.frombuffer(draw.bytes(numbers.nbytes)).reshape(numbers.shape)[bits]
    over = kinds == 1
    excess = draw.choice([-1.0, 1.0], count) * (1.0 + 10.0 ** draw.uniform(-6.0, 30.0, count))
    numbers[over, columns[over]] = (excess * largest[columns])[over]
    odd = (kinds == 2) | (bits & _in_order(numbers, limits))
    numbers[odd, columns[odd]] = draw.choice([np.nan, np.inf, -np.inf], odd.sum())
    return numbers.tolist()


def _in_order(numbers: np.ndarray, limits: SetpointLimits) -> np.ndarray:
    """Whether each command is in order after all; comparisons with NaN are false."""
    with np.errstate(all="ignore"):
        slow = np.hypot(numbers[:, 2], numbers[:, 3]) <= limits.speed_m_s
    actions = numbers[:, :2]
    return slow & ((limits.low <= actions) & (actions <= limits.high)).all(axis=1)
