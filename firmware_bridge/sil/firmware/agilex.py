"""An AgileX chassis, protocol 2; frames after the profile's own DBC.

Source: the vendor's manuals, as `firmware_bridge/profiles/agilex_v2.dbc` says. The motion state comes
faster than the manual's 20 ms where the control loop is: a pose is then never older than half a period.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from time import monotonic
from typing import Final, SupportsFloat, cast

import cantools
from cantools.database.can import Database, Message

from firmware_bridge.can.frame import Frame
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.firmware import Firmware, Heard
from firmware_bridge.sil.firmware.world import BaseState
from firmware_bridge.sil.scenario.vehicle import PROFILE

STATE_PERIOD_S: Final = 0.1
"""Of the system state; the manual allows 20 to 200 ms."""
BY_COMPUTER: Final = 1
BY_OPERATOR: Final = 3
"""Control modes; a computer cannot take the robot out of its operator's hand."""
EMERGENCY_STOP: Final = 1
"""Vehicle state."""


class AgilexChassis(Firmware[Frame]):
    """Obeys once ControlModeCommand gave it to the computer and the brake is released."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        path = profile_path(PROFILE)
        profile = load_profile(path)
        super().__init__(profile.firmware_timeout_s or 0.0, clock)
        self.control_mode = self.vehicle_state = 0
        """As SystemState tells them; whoever writes them is the operator, or the fault."""
        self.errors: dict[str, float] = {}
        """Bits of SystemState by their names in the DBC; those not named are 0."""
        self._braked, self._state_due_s = True, 0.0
        database = cantools.database.load_file(path.parent / profile.dbc)
        assert isinstance(database, Database)  # noqa: S101 - for the type checker
        message = database.get_message_by_name
        self._setpoint, self._brake = message("MotionCommand"), message("BrakeCommand")
        self._mode, self._clear = message("ControlModeCommand"), message("ClearErrorsCommand")
        self._system_state, self._motion_state = message("SystemState"), message("MotionState")
        self._commands = {m.frame_id for m in (self._setpoint, self._brake, self._mode, self._clear)}

    def _take(self, packet: Frame, arrival_s: float) -> Iterable[Frame]:
        """Obey a command; our own frames come back from a multicast bus and say nothing here."""
        if packet.frame_id not in self._commands:
            return ()
        motion = None
        if packet.frame_id == self._setpoint.frame_id:
            values = self._setpoint.decode_simple(packet.data, decode_choices=False)
            motion = BaseMotion(
                *(float(cast(SupportsFloat, values[name])) for name in ("Linear", "Lateral", "Angular"))
            )
            self._follow(motion, arrival_s)
        elif packet.frame_id == self._mode.frame_id and self.control_mode != BY_OPERATOR:
            self.control_mode = packet.data[0]
            self._state_due_s = 0.0  # it answers a change of mode at once
        elif packet.frame_id == self._brake.frame_id:
            self._braked = bool(packet.data[0])
        self._mind_mode()
        self.on_command(Heard(arrival_s, motion, packet))
        return ()

    def _telemetry(self, state: BaseState) -> Iterator[Frame]:
        now_s = self.clock()
        if now_s >= self._state_due_s:
            self._state_due_s = now_s + STATE_PERIOD_S
            stopped = EMERGENCY_STOP if self.pressed else self.vehicle_state
            modes = {"ControlMode": self.control_mode, "VehicleState": stopped}
            yield _frame(self._system_state, {**modes, **self.errors})
        if self.located and not self.stale:
            lateral, speeds = state.lateral_m_s, {"Linear": state.forward_m_s, "Angular": state.yaw_rad_s}
            yield _frame(self._motion_state, {**speeds, "Lateral": lateral})
            self.on_pose(now_s)

    def _obeys(self) -> bool:
        return self.control_mode == BY_COMPUTER and not self._braked

    def _damaged(self, packet: Frame) -> Frame:
        """Cut it short: what a controller's CRC lets through is at least whole."""
        return packet._replace(data=packet.data[: self._draw.randrange(len(packet.data))])


def _frame(message: Message, values: Mapping[str, float]) -> Frame:
    every = {signal.name: values.get(signal.name, 0.0) for signal in message.signals}
    return Frame(message.frame_id, message.encode(every, strict=False))
