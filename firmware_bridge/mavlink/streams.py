"""The messages that an autopilot is asked to send: what it grants, what is late, what was before.

Sources: MAVLink's ``common`` message set (SET_MESSAGE_INTERVAL, MESSAGE_INTERVAL); ArduPilot 4.6's
GCS_MAVLink/GCS_Common.cpp: an interval under 1.25 loop periods is denied (before, it was lengthened without a
word), and REQUEST_DATA_STREAM of any station on the same link replaces what was granted.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Final

from firmware_bridge.mavlink.messages import (
    Attitude,
    Command,
    CommandResult,
    Content,
    EstimatorStatus,
    GpsFix,
    Heartbeat,
    Landed,
    LocalPosition,
    MessageInterval,
    Odometry,
)
from firmware_bridge.mavlink.pose_rate import WATCH_S, PoseRate, longest_pose_s
from firmware_bridge.mavlink.profiles import Profile

PATIENCE_S: Final = 2.0
"""So long the pose may come too seldom while it is asked for again."""
ASK_AGAIN_S: Final = 0.4
LOOK_S: Final = 0.02
"""Between two looks at what comes too seldom: messages come more often."""
TRIES: Final = 2
"""Without an answer to so many, nothing that the autopilot is asked will be acknowledged."""

HEARTBEAT, GPS_RAW_INT, ATTITUDE, LOCAL_POSITION_NED, EXTENDED_SYS_STATE = 0, 24, 30, 32, 245
GET_INTERVAL, SET_INTERVAL = 510, 511
_STATUS_US = 200_000
_LATE_INTERVALS, _LATE_S = 3, 0.1
_ACCEPTED, _IN_PROGRESS, _UNANSWERED = 0, 5, -1


def fastest_us(loop_rate_hz: float) -> int:
    """Return the shortest interval that ArduPilot grants: 1.25 loop periods in whole milliseconds."""
    return 1000 * math.ceil(1250.0 / loop_rate_hz)


class Streams:
    """Asks for one message after the other, since an acknowledgement does not say which one it is about.

    Args:
        profile: names the estimator's message.
        period_s: of control; a pose is asked for twice in it, so that none waits a whole one for its
            tick, and more often where the period is longer than a pose may be old.
        ask: puts a command on the wire.
    """

    def __init__(self, profile: Profile, period_s: float, ask: Callable[[Command], None]) -> None:
        self.fault = ""
        """Why the poses do not suffice, once they have not for too long."""
        pose_us = round(1e6 * min(period_s, longest_pose_s(period_s)) / 2)
        status = (HEARTBEAT, profile.estimator_message, GPS_RAW_INT, EXTENDED_SYS_STATE)
        self._wanted_us = dict.fromkeys((LOCAL_POSITION_NED, ATTITUDE), pose_us)
        self._wanted_us.update(dict.fromkeys(status, _STATUS_US))
        self._numbers: dict[type[Content], int] = {
            Heartbeat: HEARTBEAT,
            Attitude: ATTITUDE,
            EstimatorStatus: profile.estimator_message,
            GpsFix: GPS_RAW_INT,
            Landed: EXTENDED_SYS_STATE,
        }
        self._rate, self._loop_rate, self._ask = PoseRate(period_s), profile.loop_rate_parameter, ask
        self._results: dict[int, int] = {}
        self._before_us: dict[int, int] = {}
        self._heard_s: dict[int, float] = {}
        self._queue: deque[int] = deque()
        self._asked_s = self._again_s = self._sufficed_s = self._looked_s = -math.inf
        self._settled_s = math.inf
        self._tries = 0

    @property
    def settled(self) -> bool:
        """Whether everything that was asked for has been answered once."""
        return self._settled_s < math.inf

    def watched(self, now_s: float) -> bool:
        """Whether the poses' interval is known since the autopilot has answered."""
        return now_s - self._settled_s >= WATCH_S

    def shortfall(self, now_s: float) -> str:
        """Say what the poses' interval is and what the control rate asks for; empty where it suffices."""
        if self._rate.suffices(now_s):
            return ""
        result = self._results.get(LOCAL_POSITION_NED, _UNANSWERED)
        answers = {_ACCEPTED: "granted", _UNANSWERED: "asked for"}
        answer = answers.get(result, f"refused with MAV_RESULT {result}")
        wanted_ms = 1e-3 * self._wanted_us[LOCAL_POSITION_NED]
        faster = f"raise {self._loop_rate}, " if self._loop_rate else ""
        return (
            f"{self._rate.shortfall(now_s)} ({wanted_ms:g} ms {answer}): "
            f"lower --rate, {faster}or keep other stations off this link"
        )

    def grant(self, loop_rate_hz: float) -> None:
        """Ask for nothing faster than a scheduler of this rate grants."""
        shortest = fastest_us(loop_rate_hz)
        self._wanted_us = {message: max(us, shortest) for message, us in self._wanted_us.items()}

    def begin(self) -> None:
        """Ask for everything from now on."""
        self._queue.extend(self._wanted_us)

    def advance(self, now_s: float) -> None:
        """Ask for the next message, or once more where no answer came."""
        if not self._queue or now_s - self._asked_s < ASK_AGAIN_S:
            return
        self._asked_s, self._tries = now_s, self._tries + 1
        if self._tries <= TRIES:
            self._ask_for(self._queue[0])
            return
        while self._queue:
            self._ask_for(self._queue[0])
            self._settle(_UNANSWERED, now_s)

    def listen(self, content: Content, now_s: float) -> None:
        """Take in what came: an answer, or a message that is asked for."""
        match content:
            case MessageInterval(message=message, interval_us=interval_us):
                self._before_us.setdefault(message, interval_us)
            case CommandResult(command=command, result=result):
                if command == SET_INTERVAL and result != _IN_PROGRESS and self._queue:
                    self._settle(result, now_s)
                    self.advance(now_s)
            case LocalPosition() | Odometry():
                self._heard_s[LOCAL_POSITION_NED] = now_s
                self._rate.hear(now_s)
            case _ if type(content) in self._numbers:
                self._heard_s[self._numbers[type(content)]] = now_s

    def watch(self, now_s: float) -> None:
        """Ask again for what comes too seldom, and take note if that does not help."""
        if now_s - self._looked_s < LOOK_S:
            return
        self._looked_s = now_s
        if self._rate.suffices(now_s):
            self._sufficed_s, self.fault = now_s, ""
        elif now_s - max(self._sufficed_s, self._settled_s) > PATIENCE_S:
            self.fault = self.shortfall(now_s)
        if self.settled and not self._queue and now_s - self._again_s >= ASK_AGAIN_S:
            self._queue.extend(message for message in self._wanted_us if self._late(message, now_s))
            if self._queue:
                self._again_s = now_s
        self.advance(now_s)

    def restore(self) -> None:
        """Set what was asked for to the intervals of before, or the autopilot's own where it told none."""
        for message in self._results:
            self._ask(Command(SET_INTERVAL, (float(message), float(self._before_us.get(message, 0)))))

    def _ask_for(self, message: int) -> None:
        if message not in self._results:
            self._ask(Command(GET_INTERVAL, (float(message),)))
        self._ask(Command(SET_INTERVAL, (float(message), float(self._wanted_us[message]))))

    def _settle(self, result: int, now_s: float) -> None:
        self._results[self._queue.popleft()] = result
        self._asked_s, self._tries = -math.inf, 0
        if not self._queue:
            self._settled_s = min(self._settled_s, now_s)

    def _late(self, message: int, now_s: float) -> bool:
        heard_s = self._heard_s.get(message, math.inf)
        return now_s - heard_s > max(_LATE_INTERVALS * 1e-6 * self._wanted_us[message], _LATE_S)
