"""What the guard adds: from the runtime's send to the frame on the bus, and what the bus takes by itself."""

import subprocess
import sys

import msgspec

from benchmarks.faults.drive import LONGEST_S, DisturbedError, Drive
from benchmarks.faults.robot import Robot
from edge_runtime.errors import BridgeError

ARRIVING_S = 1.0
"""Longest wait for frames that are under way when their sender has ended."""


def guard_latencies(kind: type[Robot], commands: int, realtime: bool = False) -> list[float]:
    """Return the seconds from each call of the runtime to the kernel's stamp of the frame's arrival.

    Every command after the first that drives is forwarded, in order: those that arrived were sent last.

    Raises:
        DisturbedError: if the robot was stopped meanwhile, or a command came too late to be forwarded, or was
            lost.
    """
    with kind() as robot, Drive(robot, commands, realtime) as drive:
        drive.await_(lambda: drive.runtime.poll() is not None, "finished")
        if drive.runtime.returncode != 0:
            raise DisturbedError(f"the {robot.name} robot was stopped while it drove")
        delays = _delays(robot, drive.runtime.stdout.read())
    if min(delays) < 0.0:
        raise DisturbedError(f"a command to the {robot.name} robot was held back or lost")
    return delays


def bus_latencies(kind: type[Robot], commands: int, realtime: bool = False) -> list[float]:
    """Return the same of a process that hands encoded frames to the bus itself: no guard, no codec.

    Raises:
        BridgeError: if a frame was lost.
    """
    with kind() as robot:
        arguments = [msgspec.json.encode(robot.spec()).decode(), str(commands), str(int(realtime))]
        sender = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            [sys.executable, "-m", "benchmarks.faults.bare_bus", *arguments],
            stdout=subprocess.PIPE,
            text=True,
        )
        robot.serve(LONGEST_S, lambda: len(robot.arrivals()) == commands or sender.poll() is not None)
        output, _ = sender.communicate(timeout=LONGEST_S)
        if sender.returncode != 0:
            raise BridgeError(f"the frames on the {robot.name} bus were not sent")
        robot.serve(ARRIVING_S, lambda: len(robot.arrivals()) == commands)
        delays = _delays(robot, output)
    if min(delays) < 0.0:
        raise BridgeError(f"a command to the {robot.name} robot was lost")
    return delays


def _delays(robot: Robot, output: str) -> list[float]:
    sent = msgspec.json.decode(output, type=list[float])
    arrived = robot.arrivals()
    return [there - here for here, there in zip(sent[-len(arrived) :], arrived, strict=True)]
