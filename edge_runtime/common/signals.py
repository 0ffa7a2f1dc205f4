"""SIGTERM, SIGINT and SIGHUP as an orderly reason to stop."""

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType
from typing import Final

GRACE_S: Final = 5.0
"""How long a loop may go on that has been told to end."""


class Overdue(BaseException):
    """Raised in whatever still runs when it should have ended; no ``except Exception`` holds it up."""


class StopSignals:
    """Turns SIGTERM, SIGINT and SIGHUP into a reason to stop, read between ticks."""

    def __init__(self) -> None:
        self.reason = ""
        self._insisting = False

    def __enter__(self) -> "StopSignals":
        """Take the signals over."""
        self._before = {
            number: signal.signal(number, self._note)
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        }
        return self

    def __exit__(self, *_: object) -> None:
        """Give them back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextlib.contextmanager
    def insist(self, longest_s: float) -> Iterator[None]:
        """Interrupt what runs in here `GRACE_S` after a signal, or after ``longest_s``, by `Overdue`."""
        before = signal.signal(signal.SIGALRM, self._interrupt)
        self._insisting = True
        signal.setitimer(signal.ITIMER_REAL, longest_s + GRACE_S)
        try:
            yield
        finally:
            self._insisting = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.reason = signal.Signals(number).name
        if self._insisting:
            signal.setitimer(signal.ITIMER_REAL, GRACE_S)

    def _interrupt(self, _number: int, _frame: FrameType | None) -> None:
        raise Overdue(f"still running {GRACE_S:g} s after {self.reason or 'the end of its time'}")


def is_interrupt(error: BaseException) -> bool:
    """Whether it stands for Ctrl-C: where signals are taken over, only somebody's code can have raised it."""
    taken_over = signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    return isinstance(error, KeyboardInterrupt) and not taken_over
