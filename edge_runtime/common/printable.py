"""Text from others, as a terminal may show it."""

from typing import Final, TypeVar

import msgspec

T = TypeVar("T")
_LONGEST: Final = 2000
"""Characters; what is longer tells nobody more."""


def printable(text: str) -> str:
    """Replace what a terminal might take for a command, or for the end of the line; cut what has no end."""
    shown = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    return "".join(letter if letter.isprintable() else "?" for letter in shown)


def first_line(error: BaseException) -> str:
    """Return what an error of somebody else's says, as one printable line of bounded length."""
    lines = str(error).strip().splitlines() or ["no reason given"]
    return printable(lines[0])


def printed(value: T) -> T:
    """Return a value, or a record and all that it holds, with texts that are printable."""
    changed: object = value
    if isinstance(value, str):
        changed = printable(value)
    elif isinstance(value, tuple):
        changed = tuple(map(printed, value))
    elif isinstance(value, dict):
        changed = {printed(key): printed(item) for key, item in value.items()}
    elif isinstance(value, msgspec.Struct):
        fields = {name: printed(getattr(value, name)) for name in value.__struct_fields__}
        changed = msgspec.structs.replace(value, **fields)
    return changed  # type: ignore[return-value]  # of the type that it was
