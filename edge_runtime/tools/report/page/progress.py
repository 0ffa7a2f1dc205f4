"""A bar for what takes more than a moment: on a terminal only, on standard error."""

import importlib.util
import sys
from collections.abc import Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")


def steps(items: Sequence[Item], what: str) -> Iterator[Item]:
    """Yield items while a bar says how many are done; without rich or a terminal nothing is shown."""
    if not sys.stderr.isatty() or importlib.util.find_spec("rich") is None:
        yield from items
        return
    from rich.console import Console  # noqa: PLC0415  # an extra
    from rich.progress import track  # noqa: PLC0415

    yield from track(items, what, console=Console(stderr=True), transient=True)
