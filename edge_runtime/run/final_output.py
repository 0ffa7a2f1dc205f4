"""The text at the end of a run, for whoever still reads: it holds up nobody."""

import contextlib
import io
import os
import threading
from typing import Final, TextIO

LONGEST_S: Final = 3.0
"""A pipe that takes nothing for so long loses the text."""


def say(text: str, stream: TextIO) -> None:
    """Write a text and its line's end; return when it is written or lost, on a pipe after `LONGEST_S`.

    A stopped terminal (Ctrl-S) is waited for: somebody sits there, and Ctrl-C ends the wait. A thread writes,
    past the stream's buffer: that buffer's lock, held in a write that never ends, would hold up the end of
    the process too.
    """
    writer = threading.Thread(target=_write, args=(f"{text}\n", stream), name="summary", daemon=True)
    writer.start()
    with contextlib.suppress(KeyboardInterrupt):
        writer.join(None if stream.isatty() else LONGEST_S)


def _write(text: str, stream: TextIO) -> None:
    with contextlib.suppress(OSError):
        try:
            descriptor = stream.fileno()
        except io.UnsupportedOperation:  # a notebook's
            stream.write(text)
            return
        rest = text.encode(stream.encoding, errors="replace")
        while rest:
            rest = rest[os.write(descriptor, rest) :]
