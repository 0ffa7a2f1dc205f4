"""What the guard does when something fails that nobody foresaw: it says so in one line, and stops the robot.

Nothing here trusts the link, or whatever library raised: each call of it may fail, again and again.
"""

import contextlib
import select
import time
import traceback
from pathlib import Path

from edge_runtime.common.printable import printable
from edge_runtime.errors import EdgeError
from firmware_bridge.guard.link import Link

LONGEST_S = 10.0
"""A stop sequence that takes longer is broken: the firmware's own timeout has long acted."""
ATTEMPTS = 3
PAUSE_S = 0.05
"""Between two attempts."""


def describe(error: BaseException) -> str:
    """Say in one line what was raised, and where; the family's own errors speak for themselves."""
    if isinstance(error, EdgeError):
        return str(error)
    kind, text = type(error).__name__, printable(" ".join(str(error).split()))
    frames = traceback.extract_tb(error.__traceback__)
    place = f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else "an unknown place"
    return f"the guard failed, {kind} in {place}{': ' if text else ''}{text}"


def stop_anyhow(link: Link) -> str:
    """Run the stop sequence, anew where a step fails; returns what failed, empty if one was completed."""
    end_s = time.monotonic() + LONGEST_S
    failure = ""
    for _ in range(ATTEMPTS):
        try:
            for delay_s in link.stop_sequence():
                time.sleep(max(0.0, min(delay_s, end_s - time.monotonic())))
                if time.monotonic() >= end_s:
                    return f"stop sequence not done after {LONGEST_S:g} s"
                _listen(link)
        except BaseException as error:  # noqa: BLE001 - told, and tried again
            failure = describe(error)
            time.sleep(PAUSE_S)
        else:
            return ""
    return f"stop sequence failed: {failure}"


def _listen(link: Link) -> None:
    """Hear what the firmware answers, where the link still can: some sequences wait for it."""
    with contextlib.suppress(BaseException):
        if select.select(link.filenos(), (), (), 0.0)[0]:
            link.receive(time.monotonic())
