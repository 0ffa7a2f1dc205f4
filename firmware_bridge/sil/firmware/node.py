"""Firmware on its wire, and the loop that serves nodes and the world in which they drive."""

import math
import select
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, Generic, Protocol, TypeVar

from edge_runtime.common.closing import Closing
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.firmware import Firmware
from firmware_bridge.sil.firmware.wires import Wire
from firmware_bridge.sil.firmware.world import BaseState

STEP_S: Final = 0.01
"""Of the plant."""
Packet = TypeVar("Packet")


class FirmwareNode(Generic[Packet]):
    """One robot's end of the wire.

    Args:
        firmware: decides.
        wire: carries; the node closes it.
    """

    def __init__(self, firmware: Firmware[Packet], wire: Wire[Packet]) -> None:
        self.firmware, self.wire = firmware, wire

    def receive(self) -> None:
        """Take in and obey everything that has arrived."""
        for packet, arrival_s in self.wire.receive():
            self._send(self.firmware.hear(packet, arrival_s))

    def report(self, state: BaseState) -> None:
        """Send the telemetry that is due."""
        self._send(self.firmware.report(state))

    def _send(self, packets: Iterable[Packet]) -> None:
        for packet in packets:
            self.wire.send(packet)


class Plant(Protocol):
    """What the nodes drive; see `firmware_bridge.sil.firmware.world.World`."""

    def step(self, motions: Sequence[BaseMotion]) -> None:
        """Advance by STEP_S while each robot follows what it was told."""
        ...

    def state(self, robot: int) -> BaseState:
        """Return what the firmware of the robot at this place in the order measures."""
        ...


class FirmwareLoop(Closing):
    """Serves nodes and plant on one grid of absolute deadlines; a context manager that lets the wires go.

    Args:
        plant: advances by STEP_S at a time.
        nodes: in the plant's order.
        report_steps: telemetry goes out every so many steps.
    """

    def __init__(self, plant: Plant, nodes: Sequence[FirmwareNode[Any]], report_steps: int = 2) -> None:
        self._plant, self._nodes, self._report_steps = plant, nodes, report_steps
        self._poll = select.poll()
        self._receivers: dict[int, Callable[[], object]] = {}
        for node in nodes:
            self.listen(node.wire.fileno(), node.receive)
        self._due_s, self._step = time.monotonic(), 0

    def close(self) -> None:
        """Let the wires go."""
        for node in self._nodes:
            node.wire.close()

    def listen(self, descriptor: int, receive: Callable[[], object]) -> None:
        """Call ``receive`` whenever something else can be read."""
        self._receivers[descriptor] = receive
        self._poll.register(descriptor, select.POLLIN)

    def forget(self, descriptor: int) -> None:
        """Look at a descriptor no more."""
        self._poll.unregister(descriptor)

    def turn(self, until_s: float = math.inf) -> float | None:
        """Wait for packets, for the next step or until a time, and do what comes.

        Returns:
            How late the plant's step was in s; None if its time has not come.
        """
        wait_s = min(self._due_s, until_s) - time.monotonic()
        for descriptor, _ in self._poll.poll(max(1e3 * wait_s, 0.0)):
            self._receivers[descriptor]()
        now_s = time.monotonic()
        if now_s < self._due_s:
            return None
        late_s = now_s - self._due_s
        self._advance(now_s)
        return late_s

    def _advance(self, now_s: float) -> None:
        self._plant.step([node.firmware.motion(now_s) for node in self._nodes])
        if self._step % self._report_steps == 0:
            for robot, node in enumerate(self._nodes):
                node.report(self._plant.state(robot))
        self._step += 1
        self._due_s += STEP_S
