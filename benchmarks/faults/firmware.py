"""The firmware's end of the wire: obeys, reports at 50 Hz, stamps every command that arrives."""

import abc
import math
import random
import select
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeVar

from firmware_bridge.guard.spec import GuardSpec

PERIOD_S = 0.02
"""Of the commands and of the firmware's reports."""
DEADLINE_S = 3 * PERIOD_S

Self = TypeVar("Self", bound="Firmware")


class Heard(NamedTuple):
    """One frame that commands."""

    time_s: float
    """Monotonic time at which the kernel took it off the wire."""
    drives: bool
    """Whether it asks for the runtime's motion, and not for less or for a stop."""


class Firmware(abc.ABC):
    """What both kinds share; a context manager that holds the wire."""

    name: str
    timeout_s = 0.5
    """Silence after which this firmware stops by itself, as the guard knows it."""

    def __init__(self) -> None:
        self.heard: list[Heard] = []
        self.stopped_itself_s = math.inf
        """Monotonic time at which the firmware's own timeout acted."""
        self._driving = False
        self._report_s = time.monotonic()

    def __enter__(self: Self) -> Self:
        """Hold the wire."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let it go."""
        self.close()

    @abc.abstractmethod
    def spec(self) -> GuardSpec:
        """Return what a guard of this firmware is started with."""

    @abc.abstractmethod
    def close(self) -> None:
        """Let the wire go."""

    @abc.abstractmethod
    def fileno(self) -> int:
        """Return the wire's descriptor."""

    @abc.abstractmethod
    def commands(self) -> Iterator[tuple[float | str, ...]]:
        """Yield the content of the commands that have arrived, without obeying them."""

    @abc.abstractmethod
    def _receive(self) -> Iterator[Heard]:
        """Take in what has arrived, obey it, and yield what commands."""

    @abc.abstractmethod
    def _report(self) -> None:
        """Send feedback."""

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Act for some seconds, or until something holds; returns whether it does."""
        end_s = time.monotonic() + seconds
        while (now_s := time.monotonic()) < end_s and not until():
            if now_s >= self._report_s:
                self._report_s = max(self._report_s + PERIOD_S, now_s)
                self._report()
                self._mind_timeout(now_s)
            select.select((self,), (), (), max(min(self._report_s, end_s) - time.monotonic(), 0.0))
            for heard in self._receive():
                self.heard.append(heard)
                self._driving = heard.drives
        return until()

    def stop_after(self, time_s: float) -> float:
        """Return when the first command other than to drive arrived since then; infinity if none did."""
        return next((h.time_s for h in self.heard if h.time_s >= time_s and not h.drives), math.inf)

    def last_drive(self) -> float:
        """Return when the last command to drive arrived."""
        return next((h.time_s for h in reversed(self.heard) if h.drives), -math.inf)

    def driving(self) -> bool:
        """Whether the last command was to drive."""
        return bool(self.heard) and self.heard[-1].drives

    def drives(self) -> int:
        """Count the commands to drive."""
        return sum(heard.drives for heard in self.heard)

    def _mind_timeout(self, now_s: float) -> None:
        if self._driving and now_s - self.heard[-1].time_s >= self.timeout_s:
            self._driving, self.stopped_itself_s = False, now_s


def to_monotonic(stamp_s: float) -> float:
    """Turn a kernel's time of arrival into monotonic time."""
    return stamp_s - (time.time() - time.monotonic())


def free_port() -> int:
    """Draw a UDP port outside the range that the kernel gives out by itself."""
    return random.randrange(20_000, 32_000)
