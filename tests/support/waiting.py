"""Waiting for what threads and other processes do: for as long as it takes, on a busy machine too."""

import time

HANG_S = 300.0
"""What has not happened by then never will; nothing that a busy machine only delays takes as long."""


def until(condition, pause_s=0.01, tell=lambda: "", by=None):
    """Wait until a condition holds; returns what it returned, and fails with what ``tell`` knows.

    ``by`` is the process that has to bring it about: one that has ended will not.
    """
    end_s = time.monotonic() + HANG_S
    while not (found := condition()):
        assert time.monotonic() < end_s, f"it never happened: {tell()}"
        assert by is None or by.poll() is None or condition(), f"it ended with {by.returncode}: {tell()}"
        time.sleep(pause_s)
    return found
