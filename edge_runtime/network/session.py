"""One end of a session with another process: which of its authentic frames are new, and how old they are.

Frames of one boot are ordered by their sequence. A frame of another boot opens a session only with the
answer to our challenge, a random number: it was made after we drew that number, by a holder of the key. So
recordings of an earlier run are refused without synchronised clocks and without a file of what was seen.
A challenge is answered once: the next boot has to answer a new one.

Whoever holds the key can still say what nobody in order would. One such frame must not make later ones, true
ones, look old: a sequence counts on with time, and nobody starts anew again and again.
"""

import math
import secrets
from collections.abc import Callable
from typing import Final, Generic, Protocol, TypeVar

from edge_runtime.network.clock_offset import RemoteClock
from edge_runtime.network.seal import FrameError, Refusal

WINDOW: Final = 64
"""Sequences before the newest of which is known whether they were received."""
_SEEN: Final = 2**WINDOW - 1
FASTEST_HZ: Final = 1000.0
"""At which anybody counts its frames."""
LAST_SEQUENCE: Final = 2**63
RESTART_S: Final = 0.5
"""Nobody starts anew twice in this time."""


class SessionFrame(Protocol):
    """What every frame carries for its session."""

    @property
    def boot_id(self) -> int:
        """Drawn by the sender at each start; sequences of different boots cannot be compared."""
        ...

    @property
    def sequence(self) -> int:
        """Counts the sender's frames of this boot."""
        ...

    @property
    def challenge(self) -> int:
        """What the receiver is to answer."""
        ...

    @property
    def answer(self) -> int:
        """The newest challenge that the sender had from the receiver; 0 before the first."""
        ...

    @property
    def stamp_s(self) -> float:
        """When the content was measured, by the sender's monotonic clock."""
        ...


AnyFrame = TypeVar("AnyFrame", bound=SessionFrame)


def random_nonce() -> int:
    """Draw a number of 64 bits that nobody can guess and that is not 0."""
    return secrets.randbits(64) or 1


class Session(Generic[AnyFrame]):
    """Our end.

    Args:
        nonce: draws challenges.
    """

    def __init__(self, nonce: Callable[[], int] = random_nonce) -> None:
        self.challenge = nonce()
        """What the other one must answer to open a session."""
        self.answer = 0
        """Its newest challenge to us; 0 before the first."""
        self.newest: AnyFrame | None = None
        self.measured_s = -math.inf
        """When the newest frame's content was measured, by our clock."""
        self._nonce = nonce
        self._clock = RemoteClock()
        self._seen = 0
        self._opened_s = self._arrival_s = -math.inf

    def admit(self, frame: AnyFrame, arrival_s: float) -> None:
        """Take in an authentic frame from this process to us; raises as `check`."""
        self.check(frame, arrival_s)
        self.accept(frame, arrival_s)

    def check(self, frame: AnyFrame, arrival_s: float) -> None:
        """Judge an authentic frame from this process to us.

        Raises:
            FrameError: if it is not newer than what is known, opens a session without the answer, or leaps.
        """
        newest = self.newest
        if newest is None or frame.boot_id != newest.boot_id:
            self._check_opening(frame, arrival_s)
            most = LAST_SEQUENCE
        elif frame.sequence <= newest.sequence:
            raise FrameError(self._behind(newest.sequence - frame.sequence))
        else:
            most = newest.sequence + WINDOW + int(FASTEST_HZ * max(0.0, arrival_s - self._arrival_s))
        if frame.sequence > most:
            raise FrameError(Refusal.SEQUENCE_LEAPS)

    def accept(self, frame: AnyFrame, arrival_s: float) -> None:
        """Take in a frame that passed `check`."""
        newest = self.newest
        if newest is None or frame.boot_id != newest.boot_id:
            self.challenge, self._opened_s = self._nonce(), arrival_s
            self._clock = RemoteClock()
            self._seen = 1
        else:
            ahead = min(frame.sequence - newest.sequence, WINDOW)
            self._seen = (self._seen << ahead | 1) & _SEEN
        self.newest, self.answer, self._arrival_s = frame, frame.challenge, arrival_s
        self._clock.heard(frame.stamp_s, arrival_s)
        self.measured_s = self._clock.local_s(frame.stamp_s)

    def age_s(self, now_s: float) -> float:
        """Return the age of the newest frame's content; infinite before the first."""
        return max(0.0, now_s - self.measured_s)

    def _check_opening(self, frame: AnyFrame, arrival_s: float) -> None:
        if frame.answer != self.challenge:
            if self.newest is None:  # it may be fresh: answering lets it prove that
                self.answer = frame.challenge
            raise FrameError(Refusal.UNANSWERED)
        if arrival_s < self._opened_s + RESTART_S:
            raise FrameError(Refusal.RESTARTS)

    def _behind(self, distance: int) -> Refusal:
        if distance >= WINDOW:
            return Refusal.REPLAYED
        bit = 1 << distance
        cause = Refusal.DUPLICATE if self._seen & bit else Refusal.REORDERED
        self._seen |= bit
        return cause
