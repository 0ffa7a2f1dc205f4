"""Rows that were measured again take their places among those of earlier runs."""

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

Row = TypeVar("Row")


def replaced(rows: Iterable[Row], newer: Iterable[Row], measured: Callable[[Row], Hashable]) -> list[Row]:
    """Return rows with the newer ones in the places of what they measured again; the others come last."""
    again = {measured(row): row for row in newer}
    kept = [again.pop(measured(row), row) for row in rows]
    return [*kept, *again.values()]
