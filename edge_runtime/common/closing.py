"""Context managers with nothing to open."""

from typing import TypeVar

Self = TypeVar("Self", bound="Closing")


class Closing:
    """Something that is open from its making on: entering returns it, leaving closes it."""

    def __enter__(self: Self) -> Self:
        """Return this."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Give back what it holds: nothing, unless a subclass says otherwise."""
