"""What the guard adds: from the runtime's send to the frame on the bus."""

import msgspec

from benchmarks.faults.drive import DisturbedError, Drive
from benchmarks.faults.firmware import Firmware
from edge_runtime.errors import BridgeError


def guard_latencies(kind: type[Firmware], commands: int) -> list[float]:
    """Return the seconds from each call of the runtime to the kernel's stamp of the frame's arrival.

    Every command after the first that drives is forwarded, in order: those that arrived were sent last.

    Raises:
        DisturbedError: if the robot was stopped meanwhile.
        BridgeError: if a command was lost.
    """
    with kind() as firmware, Drive(firmware, commands) as drive:
        drive.await_(lambda: drive.runtime.poll() is not None, "finished")
        if drive.runtime.returncode != 0:
            raise DisturbedError(f"the {firmware.name} robot was stopped while it drove")
        output = drive.runtime.stdout.read()
    sent = msgspec.json.decode(output, type=list[float])
    arrived = [heard.time_s for heard in firmware.heard if heard.drives]
    delays = [there - here for here, there in zip(sent[-len(arrived) :], arrived, strict=True)]
    if min(delays) < 0.0:
        raise BridgeError(f"the guard of the {firmware.name} robot lost a command")
    return delays
