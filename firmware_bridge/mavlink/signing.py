"""MAVLink 2 message signing: keys, timestamps that never repeat, refusal of what is not signed and fresh.

Source: the MAVLink guide, "Message Signing". A signed frame ends in link id (1 byte), timestamp (6 bytes,
little endian, 10 microseconds since 2015-01-01) and the first 6 bytes of SHA-256(key + everything before).
"""

import contextlib
import enum
import hashlib
import hmac
import threading
import time
from collections.abc import Callable
from pathlib import Path

from edge_runtime.common.durable_file import replace_durably
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import BridgeError, ConfigError

SIGNATURE_BYTES = 13
SIGNED_FLAG = 0x01
"""MAVLINK_IFLAG_SIGNED, the one incompatibility flag that this project understands."""
TICKS_PER_S = 100_000
RESERVE_TICKS = 300 * TICKS_PER_S
"""How far ahead of use timestamps are promised to disk, so that one write serves five minutes."""

_EPOCH_2015_S = 1_420_070_400
_LARGEST_TICK = 2**48 - 1
_LARGEST_FILE = 100


class SignatureCheck(enum.Enum):
    """What is to be done with a received frame."""

    ACCEPTED = enum.auto()
    UNSIGNED = enum.auto()
    ALTERED = enum.auto()
    REPLAYED = enum.auto()


def clock_ticks() -> int:
    """Return the wall clock in MAVLink's ticks."""
    return int((time.time() - _EPOCH_2015_S) * TICKS_PER_S)


class Timestamps:
    """Strictly increasing timestamps, across restarts and whatever the wall clock does.

    The file holds a tick that no frame has reached yet: a crash skips ticks, and never repeats one.
    """

    def __init__(self, path: Path, clock: Callable[[], int] = clock_ticks) -> None:
        self._path = path
        self._clock = clock
        self._writing = threading.Lock()
        self._reserved = 0
        self.last = max(clock(), self._load())
        self._reserve()

    def next(self) -> int:
        """Return the tick for the next frame to send."""
        self.raise_to(max(self.last + 1, self._clock()))
        return self.last

    def raise_to(self, tick: int) -> None:
        """Never go below a tick that an accepted frame of another sender carried."""
        self.last = max(self.last, tick)
        if self.last >= self._reserved:
            self._reserve()

    def renew(self) -> None:
        """Promise more ticks before they run out, in a thread: a slow disk must not delay a stop."""
        if self.last >= self._reserved - RESERVE_TICKS // 2 and not self._writing.locked():
            threading.Thread(target=self._renew, name="signing-timestamp", daemon=True).start()

    def close(self) -> None:
        """Store the last tick exactly, so that restarts do not run ahead of the clock."""
        self._store(self.last + 1)

    def _load(self) -> int:
        try:
            return int(read_regular(self._path, _LARGEST_FILE).decode("ascii"))
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            raise ConfigError(f"signing timestamp {self._path}: {error}; restore it or delete it") from error

    def _renew(self) -> None:
        # A disk that refuses is reported where it matters: by the frame that would use up the promise.
        with contextlib.suppress(BridgeError):
            self._reserve()

    def _reserve(self) -> None:
        if self.last > _LARGEST_TICK - RESERVE_TICKS:
            raise BridgeError(f"signing timestamp {self.last} has no successors; replace the signing key")
        self._store(self.last + RESERVE_TICKS)

    def _store(self, tick: int) -> None:
        with self._writing:
            try:
                replace_durably(self._path, f"{tick}\n".encode())
            except OSError as error:
                raise BridgeError(
                    f"signing timestamp {self._path}: {error.strerror}; make its folder writable"
                ) from error
            self._reserved = tick


class Signing:
    """One key on one link: signs what goes out, judges what comes in."""

    def __init__(self, key: bytes, timestamps: Timestamps) -> None:
        self.key = key
        self.timestamps = timestamps
        # Stricter than the guide, which takes a new stream up to a minute old: nothing recorded before this
        # start passes. A peer whose clock is behind catches up with the first of our frames that it accepts.
        self._floor = timestamps.last
        self._newest: dict[tuple[int, int, int], int] = {}

    def sign(self, frame: bytes, tick: int) -> bytes:
        """Return a frame whose flag says so with its signature, as a stream of link 0."""
        signed = frame + b"\0" + tick.to_bytes(6, "little")
        return signed + hashlib.sha256(self.key + signed).digest()[:6]

    def verify(self, frame: bytes) -> SignatureCheck:
        """Judge a whole MAVLink 2 frame; only an accepted one leaves a trace."""
        if not frame[2] & SIGNED_FLAG:
            return SignatureCheck.UNSIGNED
        if not hmac.compare_digest(hashlib.sha256(self.key + frame[:-6]).digest()[:6], frame[-6:]):
            return SignatureCheck.ALTERED
        stream = (frame[-SIGNATURE_BYTES], frame[5], frame[6])
        tick = int.from_bytes(frame[-12:-6], "little")
        if tick <= self._newest.get(stream, self._floor):
            return SignatureCheck.REPLAYED
        self._newest[stream] = tick
        self.timestamps.raise_to(tick)
        return SignatureCheck.ACCEPTED
