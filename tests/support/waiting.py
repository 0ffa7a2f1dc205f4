"""Waiting for what threads and other processes do: for as long as it takes, on a busy machine too."""

import time

HANG_S = 300.0
"""What has not happened by then never will; nothing that a busy machine only delays takes as long."""


def until(condition, pause_s=0.01, tell=lambda: ""):
    """Wait until a condition holds; returns what it returned, and fails with what ``tell`` knows."""
    end_s = time.monotonic() + HANG_S
    while not (found := condition()):
        assert time.monotonic() < end_s, f"it never happened: {tell()}"
        time.sleep(pause_s)
    return found
