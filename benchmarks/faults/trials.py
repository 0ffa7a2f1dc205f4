"""Trials of one fault: drive, break something at a random moment, see when and where the robot stopped."""

import contextlib
import math
import os
import random
import signal
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

from benchmarks.faults.drive import LONGEST_S, DisturbedError, Drive
from benchmarks.faults.robot import DEADLINE_S, PERIOD_S, CanRobot, MavlinkRobot, Robot
from edge_runtime.errors import BridgeError

ATTEMPTS = 20
LATEST_S = DEADLINE_S
"""A trial counts in which no step of the plant came later: it catches up by what it hears in the end."""

Result = TypeVar("Result")


def _stop_command(robot: Robot, fault_s: float) -> float:
    return robot.stop_after(fault_s)


def _own_timeout(robot: Robot, fault_s: float) -> float:  # noqa: ARG001
    return robot.firmware.timed_out_s


class Fault(NamedTuple):
    """Something that breaks while a robot drives."""

    name: str
    robot: type[Robot]
    cause: Callable[[Robot, Drive], None]
    stopped_s: Callable[[Robot, float], float] = _stop_command
    """When the firmware stopped or was told to; infinity as long as neither happened."""


class Stop(NamedTuple):
    """What one trial saw."""

    seconds: float
    """From the fault to the stop command, or to the firmware's own stop."""
    metres: float
    """From the fault to rest."""


def _kill_runtime(_: Robot, drive: Drive) -> None:
    drive.runtime.send_signal(signal.SIGKILL)


def _freeze_runtime(_: Robot, drive: Drive) -> None:
    drive.runtime.send_signal(signal.SIGSTOP)


def _kill_guard(_: Robot, drive: Drive) -> None:
    os.kill(drive.guard, signal.SIGKILL)


def _cut_link(robot: Robot, _: Drive) -> None:
    robot.cut()


def _tell_bus_off(robot: Robot, _: Drive) -> None:
    assert isinstance(robot, CanRobot)  # noqa: S101 - for the type checker
    robot.tell_bus_off()


_CAUSES = (
    ("kill -9 of the runtime", _kill_runtime, _stop_command),
    ("SIGSTOP of the runtime", _freeze_runtime, _stop_command),
    ("kill -9 of the guard", _kill_guard, _own_timeout),
    ("link cut", _cut_link, _own_timeout),
)
FAULTS = (
    *(Fault(name, kind, *rest) for name, *rest in _CAUSES for kind in (CanRobot, MavlinkRobot)),
    Fault("bus-off (error frame)", CanRobot, _tell_bus_off),
)


def ros_faults(kinds: Iterable[type[Robot]]) -> list[Fault]:
    """Return those that robots behind ROS have: no cable of theirs is cut here."""
    return [Fault(name, kind, *rest) for name, *rest in _CAUSES[:3] for kind in kinds]


def run_trial(fault: Fault, realtime: bool = False) -> Stop:
    """Return what came of the fault.

    Raises:
        DisturbedError: if the robot was stopped before the fault, or this machine held its plant up.
        BridgeError: if the robot was not stopped, or was commanded to drive after it was.
    """
    with fault.robot() as robot:
        with Drive(robot, realtime=realtime) as drive:
            robot.serve(LONGEST_S, lambda: robot.cruises() or drive.runtime.poll() is not None)
            robot.serve(random.uniform(0.0, PERIOD_S))
            if not robot.told_to_drive():
                raise DisturbedError(f"the {robot.name} robot was stopped before the fault")
            begin_m, fault_s = robot.position_m(), time.monotonic()
            robot.late_s = 0.0
            fault.cause(robot, drive)
            drive.await_(lambda: fault.stopped_s(robot, fault_s) < math.inf or robot.stands(), "stopped")
            drive.await_(robot.stands, "came to rest")
        stopped_s = fault.stopped_s(robot, fault_s)
        if math.isinf(stopped_s) or robot.late_s > LATEST_S:
            raise DisturbedError(f"the {robot.name} robot was stopped before the fault, or held up after it")
        if robot.arrivals()[-1] > stopped_s:
            raise BridgeError(f"{fault.name}: the {robot.name} robot was told to drive after its stop")
    return Stop(stopped_s - fault_s, math.dist(begin_m, robot.position_m()))


def undisturbed(trial: Callable[[], Result]) -> tuple[Result, int]:
    """Repeat a trial until this machine lets it come to its fault; returns also how many had to be repeated.

    Raises:
        DisturbedError: if it does not, ATTEMPTS times in a row.
    """
    for repeated in range(ATTEMPTS - 1):
        with contextlib.suppress(DisturbedError):
            return trial(), repeated
    return trial(), ATTEMPTS - 1
