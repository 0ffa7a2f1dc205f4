"""The autopilot's clock in terms of ours, by MAVLink's TIMESYNC."""

from collections import deque

from firmware_bridge.mavlink.messages import TimeSync

REMEMBERED = 32
"""Exchanges kept: a lucky one must not outlive the clocks' drift."""
LONGEST_ROUND_TRIP_S = 1.0


class Clock:
    """Keeps the offset that came with the smallest round trip: the one with the least to be wrong about."""

    def __init__(self) -> None:
        self._exchanges: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)

    @property
    def synchronised(self) -> bool:
        """Whether an answer has come."""
        return bool(self._exchanges)

    def request(self, now_s: float) -> TimeSync:
        """Return the request to send now."""
        return TimeSync(0, round(now_s * 1e9))

    def on_answer(self, answer: TimeSync, now_s: float) -> None:
        """Take in an answer; requests of others and answers to nobody are passed over."""
        round_trip_ns = round(now_s * 1e9) - answer.asker_ns
        if answer.remote_ns != 0 and 0 <= round_trip_ns <= LONGEST_ROUND_TRIP_S * 1e9:
            offset_ns = answer.asker_ns + round_trip_ns // 2 - answer.remote_ns
            self._exchanges.append((round_trip_ns, offset_ns))

    def local_s(self, boot_s: float) -> float | None:
        """Return our monotonic time at the autopilot's ``boot_s``, or None before the first answer."""
        if not self._exchanges:
            return None
        return boot_s + min(self._exchanges)[1] * 1e-9
