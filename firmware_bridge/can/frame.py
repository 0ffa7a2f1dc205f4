"""Frames, and the transport that carries them: SocketCAN, another CAN adapter, or a serial port."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

Identifier = tuple[int, bool]
"""Frame id, and whether it is an extended one of 29 bits."""


class Frame(NamedTuple):
    """One classic CAN data frame."""

    frame_id: int
    data: bytes
    extended: bool = False


class Transport(Protocol):
    """Moves frames, knows nothing of what they mean; nothing blocks once it is open.

    Raises:
        BridgeError: from any method, if the bus cannot be opened or is lost.
    """

    @property
    def malformed(self) -> int:
        """How much has arrived that is no frame."""
        ...

    def open(self) -> None:
        """Take hold of the bus."""
        ...

    def close(self) -> None:
        """Let it go."""
        ...

    def hear_only(self, identifiers: Iterable[Identifier]) -> None:
        """Have the system drop other data frames where it can: they wake nobody then."""
        ...

    def fileno(self) -> int:
        """File descriptor that is readable when frames have arrived."""
        ...

    def send(self, frame: Frame) -> bool:
        """Hand over one frame; False if the transmit queue is full and the frame is dropped."""
        ...

    def receive(self) -> Iterator[Frame]:
        """Yield the frames that have arrived."""
        ...
