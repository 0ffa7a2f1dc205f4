"""What the guard adds: from the runtime's send to the frame on the bus, and what the bus takes by itself."""

import subprocess
import sys

import msgspec

from benchmarks.faults.drive import LONGEST_S, DisturbedError, Drive
from benchmarks.faults.firmware import Firmware
from edge_runtime.errors import BridgeError


def guard_latencies(kind: type[Firmware], commands: int, realtime: bool = False) -> list[float]:
    """Return the seconds from each call of the runtime to the kernel's stamp of the frame's arrival.

    Every command after the first that drives is forwarded, in order: those that arrived were sent last.

    Raises:
        DisturbedError: if the robot was stopped meanwhile.
        BridgeError: if a command was lost.
    """
    with kind() as firmware, Drive(firmware, commands, realtime) as drive:
        drive.await_(lambda: drive.runtime.poll() is not None, "finished")
        if drive.runtime.returncode != 0:
            raise DisturbedError(f"the {firmware.name} robot was stopped while it drove")
        return _delays(firmware, drive.runtime.stdout.read())


def bus_latencies(kind: type[Firmware], commands: int, realtime: bool = False) -> list[float]:
    """Return the same of a process that hands encoded frames to the bus itself: no guard, no codec.

    Raises:
        BridgeError: if a frame was lost.
    """
    with kind() as firmware:
        arguments = [msgspec.json.encode(firmware.spec()).decode(), str(commands), str(int(realtime))]
        sender = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            [sys.executable, "-m", "benchmarks.faults.bare_bus", *arguments],
            stdout=subprocess.PIPE,
            text=True,
        )
        if not firmware.serve(LONGEST_S, lambda: sender.poll() is not None) or sender.returncode:
            sender.kill()
            raise BridgeError(f"the frames on the {firmware.name} bus were not sent")
        return _delays(firmware, sender.communicate()[0])


def _delays(firmware: Firmware, output: str) -> list[float]:
    sent = msgspec.json.decode(output, type=list[float])
    arrived = [heard.time_s for heard in firmware.heard if heard.drives]
    delays = [there - here for here, there in zip(sent[-len(arrived) :], arrived, strict=True)]
    if min(delays) < 0.0:
        raise BridgeError(f"a command to the {firmware.name} robot was lost")
    return delays
