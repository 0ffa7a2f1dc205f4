"""SIGTERM, SIGINT and SIGHUP as an orderly reason to stop."""

import signal
from types import FrameType, TracebackType


class StopSignals:
    """Turns SIGTERM, SIGINT and SIGHUP into a reason to stop, read between ticks."""

    def __init__(self) -> None:
        self.reason = ""

    def __enter__(self) -> "StopSignals":
        """Take the signals over."""
        self._before = {
            number: signal.signal(number, self._note)
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        }
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Give them back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.reason = signal.Signals(number).name
