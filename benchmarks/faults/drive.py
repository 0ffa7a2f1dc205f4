"""One runtime process with its guard, driving one firmware."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable

import msgspec

from benchmarks.faults.robot import Robot
from edge_runtime.errors import BridgeError

LONGEST_S = 60.0
FOREVER = 1_000_000
"""Commands; a trial ends long before."""


class DisturbedError(BridgeError):
    """The robot was stopped before anything was broken: a busy machine held the runtime past its deadline."""


class Drive:
    """A context manager that ends both processes; ``robot`` serves while anything is waited for."""

    def __init__(self, robot: Robot, commands: int = FOREVER, realtime: bool = False) -> None:
        self._robot = robot
        self.runtime = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            [
                sys.executable,
                "-m",
                "benchmarks.faults.runtime",
                msgspec.json.encode(robot.spec()).decode(),
                str(commands),
                str(int(realtime)),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> "Drive":
        """Wait until the robot drives.

        Raises:
            DisturbedError: if the runtime ended before, with the last line that it wrote, or its guard.
        """
        self.await_(lambda: len(self._robot.arrivals()) >= 5 or self.runtime.poll() is not None, "drove")
        if self.runtime.poll() is not None:
            raise DisturbedError(f"the runtime ended: {self.runtime.communicate()[1].splitlines()[-1]}")
        assert self.runtime.stdout is not None  # noqa: S101 - for the type checker
        self.guard = int(self.runtime.stdout.readline())
        try:
            self._guard_ended = os.pidfd_open(self.guard)
        except ProcessLookupError:
            raise DisturbedError(f"the guard of the {self._robot.name} robot has ended") from None
        return self

    def __exit__(self, *_: object) -> None:
        """Kill the runtime, wait for the guard's end."""
        self.runtime.send_signal(signal.SIGKILL)
        self.await_(self._ended, "ended")
        os.close(self._guard_ended)
        self.runtime.communicate()

    def await_(self, condition: Callable[[], bool], what: str) -> None:
        """Serve until something holds.

        Raises:
            BridgeError: if it takes too long.
        """
        if not self._robot.serve(LONGEST_S, condition):
            raise BridgeError(f"the {self._robot.name} robot never {what}")

    def _ended(self) -> bool:
        return bool(select.select((self._guard_ended,), (), (), 0.0)[0])
