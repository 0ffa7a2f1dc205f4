"""What the autopilot's heartbeats prove: its mode, its arming, and whether somebody else took the robot."""

from firmware_bridge.mavlink.messages import Heartbeat
from firmware_bridge.mavlink.profiles import Mode, Profile


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
        self._expected: frozenset[int] = frozenset()
        self._was_armed = False

    @property
    def armed(self) -> bool:
        """Whether the last heartbeat said so."""
        return self.heartbeat is not None and self.heartbeat.armed

    def in_mode(self, mode: Mode) -> bool:
        """Whether the last heartbeat reported that mode."""
        return self.heartbeat is not None and self.heartbeat.custom_mode == mode.reported

    @property
    def ready(self) -> bool:
        """Whether the autopilot follows setpoints."""
        return self.armed and self.in_mode(self._profile.command_mode)

    def expect_taking(self) -> None:
        """From now on only the present mode and ours are expected."""
        self._expect(self._profile.command_mode.reported, *self._present())

    def expect_driving(self) -> None:
        """From now on only our mode is expected."""
        self._expect(self._profile.command_mode.reported)

    def expect_stopping(self) -> None:
        """From now on the stop mode is expected, and the present one until it is reached."""
        self._expect(self._profile.stop_mode.reported, *self._present())

    def on_heartbeat(self, heartbeat: Heartbeat, now_s: float) -> None:
        """Take in a heartbeat and notice an operator's or a failsafe's hand."""
        self.heartbeat, self.heartbeat_s = heartbeat, now_s
        if not self.taken or self.override:
            return
        if heartbeat.custom_mode not in self._expected:
            self.override = f"an operator or failsafe chose mode {heartbeat.custom_mode:#x}"
        elif self._was_armed and not heartbeat.armed:
            self.override = "an operator or failsafe disarmed the robot"
        self._was_armed = heartbeat.armed

    def _present(self) -> tuple[int, ...]:
        return () if self.heartbeat is None else (self.heartbeat.custom_mode,)

    def _expect(self, *modes: int) -> None:
        self.taken = True
        self._expected = frozenset(modes)
        self._was_armed = self._was_armed or self.armed
