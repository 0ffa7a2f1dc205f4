"""What one check before a run finds, and how a person reads it: a line each."""

import enum
from collections.abc import Callable

import msgspec

from edge_runtime.common.printable import printable
from edge_runtime.errors import EdgeError


class Verdict(enum.Enum):
    """How a check ended; the value is the colour of its word on a terminal (ANSI)."""

    OK = 32
    WARN = 33
    """The robot can be run; somebody should know."""
    FAIL = 31
    """The robot must not be run like this."""


class Finding(msgspec.Struct, frozen=True):
    """The outcome of one check."""

    verdict: Verdict
    detail: str
    """What was found, with its numbers."""
    remedy: str = ""
    """What to do about it; empty where nothing is to be done or the detail says it."""
    name: str = ""
    """Of the check; given by `examine`."""


def ok(detail: str) -> Finding:
    """Nothing to do."""
    return Finding(Verdict.OK, detail)


def warn(detail: str, remedy: str) -> Finding:
    """Worth knowing."""
    return Finding(Verdict.WARN, detail, remedy)


def fail(detail: str, remedy: str = "") -> Finding:
    """Not to be run."""
    return Finding(Verdict.FAIL, detail, remedy)


def examine(name: str, check: Callable[[], Finding]) -> Finding:
    """Make a check; what it cannot reach or refuses is a failure like any other."""
    try:
        found = check()
    except (EdgeError, OSError) as error:
        found = fail(str(error))
    return msgspec.structs.replace(found, name=name)


def line(finding: Finding, *, colour: bool) -> str:
    """One finding for a person."""
    word = f"{finding.verdict.name.lower():<5}"
    if colour:
        word = f"\x1b[{finding.verdict.value}m{word}\x1b[0m"
    text = f"{finding.detail}; {finding.remedy}" if finding.remedy else finding.detail
    return f"{word} {finding.name:<17} {printable(' '.join(text.split()))}"
