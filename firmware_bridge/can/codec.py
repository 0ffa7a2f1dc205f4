"""Motions to CAN frames and frames to values, after a profile and its DBC; no bus, no clock."""

import math
from pathlib import Path
from typing import NamedTuple

from cantools.database.errors import DecodeError

from firmware_bridge.can.e2e import Protection, counter_of, protect
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.profile import Gains, Profile, Step
from firmware_bridge.can.reader import Reader
from firmware_bridge.can.vocabulary import read_vocabulary
from firmware_bridge.kinematics.base import BaseMotion


class Decoded(NamedTuple):
    """One feedback frame, understood."""

    message: str
    values: dict[str, float]
    """Physical values by ``Message.Signal``."""


class CanCodec:
    """Encodes motions and steps, decodes feedback; malformed feedback is counted and yields nothing.

    Raises:
        ConfigError: as `read_vocabulary`.
    """

    def __init__(self, profile: Profile, path: Path) -> None:
        self.malformed = 0
        """Feedback frames refused so far: wrong length, CRC, repeated counter, not finite."""
        self._profile = profile
        self._layouts, self._identifiers, self._feedback = read_vocabulary(profile, path)
        self.heard = tuple(self._feedback)
        """Identifiers of the feedback; what other frames say is of no interest."""
        self._counters: dict[str, int] = {}

    def encode(self, motion: BaseMotion) -> tuple[Frame, ...]:
        """Return the command frames of one motion; values beyond a signal saturate before they are scaled."""
        return tuple(
            self._frame(name, {signal: _weighted(gains, motion) for signal, gains in signals.items()})
            for name, signals in self._profile.motion.items()
        )

    def encode_step(self, step: Step) -> Frame:
        """Return the frame of one step of a sequence."""
        return self._frame(step.message, step.signals)

    def decode(self, frame: Frame) -> Decoded | None:
        """Return what a feedback frame says; None for other frames, our own echoes included."""
        reader = self._feedback.get((frame.frame_id, frame.extended))
        if reader is None:
            return None
        values = self._values(reader, frame.data[: reader.length])
        if values is None:
            self.malformed += 1
            return None
        return Decoded(reader.name, values)

    def _frame(self, name: str, values: dict[str, float]) -> Frame:
        data = self._layouts[name].encode(values)
        protection = self._profile.protection.get(name)
        if protection is not None:
            data = self._protected(name, data, protection)
        frame_id, extended = self._identifiers[name]
        return Frame(frame_id, data, extended)

    def _protected(self, name: str, data: bytes, protection: Protection) -> bytes:
        counter = (self._counters.get(name, -1) + 1) % protection.counters
        self._counters[name] = counter
        return protect(data, counter, protection)

    def _values(self, reader: Reader, data: bytes) -> dict[str, float] | None:
        if len(data) < reader.length or not self._is_fresh(reader.name, data):
            return None
        try:
            values = reader.read(data)
        except (DecodeError, ValueError):
            return None
        return values if all(map(math.isfinite, values.values())) else None

    def _is_fresh(self, name: str, data: bytes) -> bool:
        """Check CRC and counter of protected feedback: a frame received before is refused."""
        protection = self._profile.protection.get(name)
        if protection is None:
            return True
        counter = counter_of(data, protection)
        if counter is None or counter == self._counters.get(name):
            return False
        self._counters[name] = counter
        return True


def _weighted(gains: Gains, motion: BaseMotion) -> float:
    return (
        gains.forward * motion.forward_m_s
        + gains.lateral * motion.lateral_m_s
        + gains.yaw * motion.yaw_rad_s
        + gains.steering * motion.steering_rad
    )
