"""What the autopilot's heartbeats prove: its type, mode and arming, and whether somebody else took it."""

from firmware_bridge.mavlink.messages import Heartbeat, Landed
from firmware_bridge.mavlink.profiles import COPTERS, Mode, Profile, misfit

_STANDBY = 3
"""MAV_STATE: what ArduCopter reports while it is landed, armed or not."""
_ON_GROUND = 1
"""MAV_LANDED_STATE."""


class Vehicle:
    """Follows mode and arming. An override is final: nothing here ever forgets it."""

    def __init__(self, profile: Profile) -> None:
        self.override = ""
        """Who took the robot and how; empty while nobody did."""
        self.heartbeat: Heartbeat | None = None
        self.heartbeat_s = 0.0
        self.taken = False
        """Whether this project ever asked for the robot."""
        self._profile = profile
        self._commanded = profile.command_mode
        self._present: int | None = None
        self._was_armed = False
        self._landed: Landed | None = None

    @property
    def armed(self) -> bool:
        """Whether the last heartbeat said so."""
        return self.heartbeat is not None and self.heartbeat.armed

    @property
    def misfit(self) -> str:
        """What it is, where the profile is for another vehicle; empty where it fits, or is not known yet."""
        beat = self.heartbeat
        return "" if beat is None else misfit(self._profile, beat.autopilot, beat.kind)

    @property
    def grounded(self) -> bool:
        """Whether it is a copter that does not fly."""
        beat = self.heartbeat
        if beat is None or beat.kind not in COPTERS:
            return False
        landed = self._landed is not None and self._landed.state == _ON_GROUND
        return landed or not beat.armed or beat.status == _STANDBY

    def in_mode(self, mode: Mode) -> bool:
        """Whether the last heartbeat reported that mode."""
        return self.heartbeat is not None and self.heartbeat.custom_mode == mode.reported

    @property
    def ready(self) -> bool:
        """Whether the autopilot follows setpoints."""
        return self.armed and self.in_mode(self._profile.command_mode)

    def expect(self, mode: Mode) -> None:
        """This mode is now commanded: until a heartbeat shows it, the present one is nobody else's choice."""
        self.taken = True
        self._commanded = mode
        self._present = None if self.heartbeat is None else self.heartbeat.custom_mode
        self._was_armed = self._was_armed or self.armed

    def on_landed(self, landed: Landed) -> None:
        """Take in whether it flies."""
        self._landed = landed

    def on_heartbeat(self, heartbeat: Heartbeat, now_s: float) -> None:
        """Take in a heartbeat and notice an operator's or a failsafe's hand."""
        self.heartbeat, self.heartbeat_s = heartbeat, now_s
        if not self.taken or self.override:
            return
        mode = heartbeat.custom_mode
        if mode == self._commanded.reported:
            self._present = None
        elif mode != self._present:
            self.override = f"an operator or failsafe chose mode {mode:#x}"
        if self._was_armed and not heartbeat.armed:
            self.override = self.override or "an operator, a failsafe or a landing disarmed the robot"
        self._was_armed = heartbeat.armed
