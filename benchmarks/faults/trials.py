"""Trials of one fault: drive, break something at a random moment, see when the firmware heard of a stop."""

import contextlib
import os
import random
import signal
import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from benchmarks.faults.can_firmware import CanFirmware
from benchmarks.faults.drive import DisturbedError, Drive
from benchmarks.faults.firmware import PERIOD_S, Firmware
from benchmarks.faults.mavlink_firmware import MavlinkFirmware
from edge_runtime.errors import BridgeError

ATTEMPTS = 20

Result = TypeVar("Result")


def _stop_command(firmware: Firmware, fault_s: float) -> float:
    return firmware.stop_after(fault_s)


def _own_timeout(firmware: Firmware, fault_s: float) -> float:  # noqa: ARG001
    return firmware.stopped_itself_s


class Fault(NamedTuple):
    """Something that breaks while a robot drives."""

    name: str
    firmware: type[Firmware]
    cause: Callable[[Firmware, Drive], None]
    stopped_s: Callable[[Firmware, float], float] = _stop_command
    """When the firmware stopped or was told to; infinity as long as neither happened."""


def _kill_runtime(_: Firmware, drive: Drive) -> None:
    drive.runtime.send_signal(signal.SIGKILL)


def _freeze_runtime(_: Firmware, drive: Drive) -> None:
    drive.runtime.send_signal(signal.SIGSTOP)


def _kill_guard(_: Firmware, drive: Drive) -> None:
    os.kill(drive.guard, signal.SIGKILL)


def _tell_bus_off(firmware: Firmware, _: Drive) -> None:
    assert isinstance(firmware, CanFirmware)  # noqa: S101 - for the type checker
    firmware.tell_bus_off()


FAULTS = (
    *(Fault("kill -9 of the runtime", kind, _kill_runtime) for kind in (CanFirmware, MavlinkFirmware)),
    *(Fault("SIGSTOP of the runtime", kind, _freeze_runtime) for kind in (CanFirmware, MavlinkFirmware)),
    *(
        Fault("kill -9 of the guard", kind, _kill_guard, _own_timeout)
        for kind in (CanFirmware, MavlinkFirmware)
    ),
    Fault("bus-off (error frame)", CanFirmware, _tell_bus_off),
)


def run_trial(fault: Fault, realtime: bool = False) -> float:
    """Return the seconds from the fault to the stop.

    Raises:
        DisturbedError: if the robot was stopped before the fault.
        BridgeError: if the robot was not stopped, or was commanded to drive after it was.
    """
    with fault.firmware() as firmware:
        with Drive(firmware, realtime=realtime) as drive:
            firmware.serve(random.uniform(0.0, PERIOD_S))
            if not firmware.driving():
                raise DisturbedError(f"the {firmware.name} robot was stopped before the fault")
            fault_s = time.monotonic()
            fault.cause(firmware, drive)
            drive.await_(lambda: fault.stopped_s(firmware, fault_s) < float("inf"), "stopped")
        stopped_s = fault.stopped_s(firmware, fault_s)
        if firmware.last_drive() > stopped_s:
            raise BridgeError(f"{fault.name}: the {firmware.name} robot was told to drive after its stop")
    return stopped_s - fault_s


def undisturbed(trial: Callable[[], Result]) -> tuple[Result, int]:
    """Repeat a trial until this machine lets it come to its fault; returns also how many had to be repeated.

    Raises:
        DisturbedError: if it does not, ATTEMPTS times in a row.
    """
    for repeated in range(ATTEMPTS - 1):
        with contextlib.suppress(DisturbedError):
            return trial(), repeated
    return trial(), ATTEMPTS - 1
