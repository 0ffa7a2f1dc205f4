"""An AgileX chassis, protocol 2, on a python-can bus; frames after the profile's own DBC.

Source: the vendor's manuals, as `firmware_bridge/profiles/agilex_v2.dbc` says. The motion state comes
faster than the manual's 20 ms where the control loop is: a pose is then never older than half a period.
"""

import contextlib
import random
import time
from typing import Final, SupportsFloat, cast

import can
import cantools
from cantools.database.can import Database

from firmware_bridge.can.bus import bus_arguments
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.sil.firmware.node import FirmwareNode, Pace, to_monotonic
from firmware_bridge.sil.firmware.world import Pose
from firmware_bridge.sil.scenario.scenario import PROFILE

STATE_PERIOD_S: Final = 0.1
"""Of the system state; the manual allows 20 to 200 ms."""
_COMMANDS: Final = 1


class CanNode(FirmwareNode):
    """Obeys once ControlModeCommand gave it to the computer and the brake is released."""

    def __init__(self, robot_id: int, address: str, pace: Pace) -> None:
        super().__init__(robot_id, pace)
        path = profile_path(PROFILE)
        profile = load_profile(path)
        self.timeout_s = profile.firmware_timeout_s or 0.0
        database = cantools.database.load_file(path.parent / profile.dbc)
        assert isinstance(database, Database)  # noqa: S101 - for the type checker
        message = database.get_message_by_name
        self._command, self._brake = message("MotionCommand"), message("BrakeCommand")
        self._control, self._clear = message("ControlModeCommand"), message("ClearErrorsCommand")
        self._system_state, self._motion_state = message("SystemState"), message("MotionState")
        self._mode, self._braked, self._state_due_s = 0, True, 0.0
        self._draw = random.Random(robot_id)
        self._bus = can.Bus(**bus_arguments(address))  # type: ignore[arg-type]

    def fileno(self) -> int:
        """Return the bus's descriptor."""
        return self._bus.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def receive(self) -> None:
        """Take in and obey every frame; our own come back from a multicast bus and say nothing here."""
        while (frame := self._bus.recv(timeout=0)) is not None:
            if frame.arbitration_id == self._command.frame_id:
                self._drive(frame)
            elif frame.arbitration_id == self._control.frame_id:
                self._mode = frame.data[0]
                self._state_due_s = 0.0  # it answers a change of mode at once
            elif frame.arbitration_id == self._brake.frame_id:
                self._braked = bool(frame.data[0])
            if not self._obeys():
                self._halt()

    def report(self, pose: Pose) -> None:
        """Send the motion state, and the system state when it is due."""
        now_s = time.monotonic()
        if now_s >= self._state_due_s:
            self._state_due_s = now_s + STATE_PERIOD_S
            self._send(self._system_state, {"ControlMode": self._mode})
        if self.stale or not self.located:
            return
        self._send(self._motion_state, {"Linear": pose.forward_m_s, "Angular": pose.yaw_rad_s})
        self._sent_pose(now_s)

    def _drive(self, frame: can.Message) -> None:
        values = self._command.decode_simple(bytes(frame.data), decode_choices=False)
        linear, angular = (float(cast(SupportsFloat, values[name])) for name in ("Linear", "Angular"))
        self._follow(to_monotonic(frame.timestamp), (linear, angular), obeys=self._obeys())

    def _obeys(self) -> bool:
        return self._mode == _COMMANDS and not self._braked

    def _send(self, message: "cantools.database.can.Message", values: dict[str, float]) -> None:
        every = {signal.name: values.get(signal.name, 0.0) for signal in message.signals}
        data = message.encode(every, strict=False)
        if self.corrupt:  # cut short: what a controller's CRC lets through is at least whole
            data = data[: self._draw.randrange(len(data))]
        with contextlib.suppress(can.CanOperationError):  # a full queue: the next one comes soon
            self._bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))
