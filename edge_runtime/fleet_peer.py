"""One robot's session with another: which of the authentic frames are new.

Frames of one boot are ordered by their sequence. A frame of another boot opens a session only with the
answer to our challenge, a random number: it was made after we drew that number, by a holder of the key. So
recordings of an earlier run are refused without synchronised clocks and without a file of what was seen.
A challenge is answered once: the next boot has to answer a new one.
"""

import math
import secrets
from collections.abc import Callable
from typing import Final

from msgspec.structs import replace

from edge_runtime.fleet_clock import RemoteClock
from edge_runtime.fleet_wire import Following, Frame, FrameError, Refusal
from edge_runtime.messages import RobotState, Teammate, Vector2

WINDOW: Final = 64
"""Sequences before the newest of which is known whether they were received."""
_SEEN: Final = 2**WINDOW - 1


def random_nonce() -> int:
    """Draw a number of 64 bits that nobody can guess and that is not 0."""
    return secrets.randbits(64) or 1


class Peer:
    """What one robot knows of another.

    Args:
        robot_id: of the other.
        nonce: draws challenges.
    """

    def __init__(self, robot_id: int, nonce: Callable[[], int] = random_nonce) -> None:
        self.robot_id = robot_id
        self.challenge = nonce()
        """What it must answer to open a session."""
        self.answer = 0
        """Its newest challenge to us; 0 before the first."""
        self.newest: Frame | None = None
        self._nonce = nonce
        self._clock = RemoteClock()
        self._measured_s = -math.inf
        self._seen = 0

    def admit(self, frame: Frame, arrival_s: float) -> None:
        """Take in an authentic frame from this robot to us.

        Raises:
            FrameError: if it is not newer than what is known, or opens a session without the answer.
        """
        newest = self.newest
        if newest is None or frame.boot_id != newest.boot_id:
            self._open(frame)
        elif frame.sequence <= newest.sequence:
            raise FrameError(self._behind(newest.sequence - frame.sequence))
        else:
            ahead = min(frame.sequence - newest.sequence, WINDOW)
            self._seen = (self._seen << ahead | 1) & _SEEN
        self.newest, self.answer = frame, frame.challenge
        self._clock.heard(frame.state.stamp_s, arrival_s)
        self._measured_s = self._clock.local_s(frame.state.stamp_s)

    def age_s(self, now_s: float) -> float:
        """Return the age of its newest state; infinite before the first."""
        return max(0.0, now_s - self._measured_s)

    def teammate(self, now_s: float) -> Teammate:
        """Return its newest state, stamped in our clock; there must be one."""
        if self.newest is None:
            raise LookupError(f"robot {self.robot_id} has not been heard")
        state = replace(self.newest.state, stamp_s=self._measured_s)
        return Teammate(state, self.newest.intended_action, self.age_s(now_s))

    def frame(
        self,
        boot_id: int,
        sequence: int,
        state: RobotState,
        action: Vector2,
        tick: int,
        following: Following,
        *,
        listens: bool,
    ) -> Frame:
        """Return our next frame to this robot."""
        return Frame(
            self.robot_id,
            boot_id,
            sequence,
            self.challenge,
            self.answer,
            state,
            action,
            listens,
            tick,
            following,
        )

    def _open(self, frame: Frame) -> None:
        if frame.answer != self.challenge:
            if self.newest is None:  # it may be fresh: answering lets it prove that
                self.answer = frame.challenge
            raise FrameError(Refusal.UNANSWERED)
        self.challenge = self._nonce()
        self._clock = RemoteClock()
        self._seen = 1

    def _behind(self, distance: int) -> Refusal:
        if distance >= WINDOW:
            return Refusal.REPLAYED
        bit = 1 << distance
        cause = Refusal.DUPLICATE if self._seen & bit else Refusal.REORDERED
        self._seen |= bit
        return cause
