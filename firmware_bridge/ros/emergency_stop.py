"""A robot's emergency stop as its topic tells it: pressed, released, or fallen silent."""

from firmware_bridge.ros.profile import RosProfile


class EmergencyStop:
    """What was said last, and when.

    As a lock of twist_mux that has a timeout does, silence counts as a reason to stand: nobody knows whether
    it is pressed.

    Args:
        profile: names topic and longest silence.
    """

    def __init__(self, profile: RosProfile) -> None:
        self.pressed: bool | None = None
        """None as long as it has said nothing."""
        self._topic, self._longest_s = profile.emergency_stop, profile.emergency_stop_silent_s
        self._since_s: float | None = None

    def expect(self, now_s: float) -> None:
        """Somebody publishes it: from now on it is to be heard."""
        self._since_s = now_s

    def take(self, pressed: bool, now_s: float) -> None:
        """Take in what it says."""
        self.pressed, self._since_s = pressed, now_s

    def fault(self, now_s: float) -> str:
        """Say for how long it has been silent; empty where that is no longer than allowed."""
        if self._longest_s is None or self._since_s is None or now_s - self._since_s <= self._longest_s:
            return ""
        return f"the emergency stop has been silent for {now_s - self._since_s:.1f} s ({self._topic})"
