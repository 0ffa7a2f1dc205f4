"""How often an autopilot sends each message: asked for, denied, and changed by whoever else shares the link.

Source: ArduPilot 4.6's GCS_MAVLink/GCS_Common.cpp: set_message_interval, handle_command_get_message_interval,
handle_request_data_stream.
"""

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect  # type: ignore[import-untyped]

STREAM_PERIOD_S: Final = 0.25
"""Until SET_MESSAGE_INTERVAL asks for another."""
_DISABLED: Final = -1


class Intervals:
    """The messages of one link and when each is due.

    Args:
        messages: numbers of those that it can send.
    """

    def __init__(self, messages: tuple[int, ...]) -> None:
        self.period_s: dict[int, float] = dict.fromkeys(messages, STREAM_PERIOD_S)
        self._due_s = dict.fromkeys(messages, 0.0)

    def set(self, message: int, interval_us: float, loop_rate_hz: float | None) -> int:
        """Take a wish and return its MAV_RESULT: with a loop rate, faster than 80 % of it is denied."""
        if message not in self.period_s:
            return int(dialect.MAV_RESULT_DENIED)
        period_s = STREAM_PERIOD_S if interval_us == 0.0 else 1e-6 * interval_us
        if loop_rate_hz is not None and interval_us > 0.0 and interval_us // 1000 * 800 < 1e6 / loop_rate_hz:
            return int(dialect.MAV_RESULT_DENIED)
        self.period_s[message] = period_s
        return int(dialect.MAV_RESULT_ACCEPTED)

    def get_us(self, message: int) -> int:
        """Return the interval as MESSAGE_INTERVAL tells it: -1 disabled, 0 not available."""
        period_s = self.period_s.get(message, 0.0)
        return _DISABLED if period_s < 0.0 else round(1e6 * period_s)

    def request_all(self, rate_hz: int) -> None:
        """Obey a station's REQUEST_DATA_STREAM: what was granted before is forgotten, but for heartbeats."""
        for message in self.period_s:
            if message != dialect.MAVLINK_MSG_ID_HEARTBEAT:
                self.period_s[message] = 1.0 / rate_hz

    def send_now(self, message: int) -> None:
        """Make a message due, if it can be sent."""
        if message in self._due_s:
            self._due_s[message] = 0.0

    def due(self, now_s: float) -> list[int]:
        """Return the messages whose time has come, on a grid: what the loop is late by does not add up."""
        due = [message for message, due_s in self._due_s.items() if self._is_due(message, due_s, now_s)]
        for message in due:
            self._due_s[message] = max(self._due_s[message] + self.period_s[message], now_s)
        return due

    def _is_due(self, message: int, due_s: float, now_s: float) -> bool:
        return now_s >= due_s and (self.period_s[message] > 0.0 or due_s == 0.0)
