"""Motions to CAN frames and frames to values, after a profile and its DBC; no bus, no clock."""

import math
from pathlib import Path
from typing import NamedTuple, NoReturn, SupportsFloat, cast

import cantools
from cantools.database.can import Database, Message
from cantools.database.errors import DecodeError, Error

from edge_runtime.errors import ConfigError
from firmware_bridge.can.e2e import Protection, counter_of, protect
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.layout import Layout
from firmware_bridge.can.profile import Gains, Profile, Step
from firmware_bridge.kinematics.base import Motion


class Decoded(NamedTuple):
    """One feedback frame, understood."""

    message: str
    values: dict[str, float]
    """Physical values by ``Message.Signal``."""


class CanCodec:
    """Encodes motions and steps, decodes feedback; malformed feedback is counted and yields nothing.

    Raises:
        ConfigError: if the DBC cannot be read, lacks what the profile names, or cannot carry its limits.
    """

    def __init__(self, profile: Profile, path: Path) -> None:
        self.malformed = 0
        """Feedback frames refused so far: wrong length, CRC, repeated counter, not finite."""
        self._profile = profile
        self._path = path
        self._messages = _messages(profile, path)
        self._ids = {name: profile.frame_ids.get(name, m.frame_id) for name, m in self._messages.items()}
        self._layouts = {n: Layout(m) for n, m in self._messages.items() if not m.is_multiplexed()}
        self._counters: dict[str, int] = {}
        self._check_commands()
        self._feedback = self._feedback_by_id()
        self._check_limits()

    def encode(self, motion: Motion) -> tuple[Frame, ...]:
        """Return the command frames of one motion; values beyond a signal saturate before they are scaled."""
        return tuple(
            self._frame(name, {signal: _weighted(gains, motion) for signal, gains in signals.items()})
            for name, signals in self._profile.motion.items()
        )

    def rehearse(self, motion: Motion) -> None:
        """Encode a motion and forget it: the next frame's counter does not advance."""
        counters = self._counters.copy()
        self.encode(motion)
        self._counters = counters

    def encode_step(self, step: Step) -> Frame:
        """Return the frame of one step of a sequence."""
        return self._frame(step.message, step.signals)

    def decode(self, frame: Frame) -> Decoded | None:
        """Return what a feedback frame says; None for other frames, our own echoes included."""
        message = self._feedback.get((frame.frame_id, frame.extended))
        if message is None:
            return None
        values = self._values(message, frame.data)
        if values is None:
            self.malformed += 1
            return None
        return Decoded(message.name, values)

    def _frame(self, name: str, values: dict[str, float]) -> Frame:
        data = self._layouts[name].encode(values)
        protection = self._profile.protection.get(name)
        if protection is not None:
            data = self._protected(name, data, protection)
        return Frame(self._ids[name], data, self._messages[name].is_extended_frame)

    def _protected(self, name: str, data: bytes, protection: Protection) -> bytes:
        counter = (self._counters.get(name, -1) + 1) % protection.counters
        self._counters[name] = counter
        return protect(data, counter, protection)

    def _values(self, message: Message, data: bytes) -> dict[str, float] | None:
        if len(data) < message.length or not self._is_fresh(message.name, data[: message.length]):
            return None
        try:
            decoded = message.decode_simple(data[: message.length], decode_choices=False)
        except (DecodeError, ValueError):
            return None
        values = {
            f"{message.name}.{name}": float(cast(SupportsFloat, value)) for name, value in decoded.items()
        }
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

    def _check_commands(self) -> None:
        profile = self._profile
        for name, signals in profile.motion.items():
            self._check_command(f"motion.{name}", name, signals)
        for key, steps in (("enable", profile.enable), ("stop.then", profile.stop.then)):
            for index, step in enumerate(steps):
                self._check_step(f"{key}[{index}]", step)
        for table, names in (("frame_ids", profile.frame_ids), ("protection", profile.protection)):
            for name in names:
                self._message(f"{table}.{name}", name)
        for name in profile.protection:
            if self._message("protection", name).length < 2:
                self._refuse(f"protection.{name}", "the message is too short for a counter and a CRC")

    def _check_step(self, key: str, step: Step) -> None:
        self._check_command(f"{key}.signals", step.message, step.signals)
        for name, value in step.signals.items():
            low, high = self._layouts[step.message].ranges[name]
            if not low <= value <= high:
                self._refuse(f"{key}.signals.{name}", f"the DBC's signal cannot carry {value:g}")

    def _check_command(self, key: str, name: str, signals: "dict[str, Gains] | dict[str, float]") -> None:
        self._check_signals(key, name, signals)
        if name not in self._layouts:
            self._refuse(key, f"{name} is multiplexed: give the DBC a message without a multiplexer for it")

    def _check_signals(self, key: str, name: str, signals: "dict[str, Gains] | dict[str, float]") -> None:
        known = [signal.name for signal in self._message(key, name).signals]
        for signal in signals:
            if signal not in known:
                self._refuse(f"{key}.{signal}", f"no such signal in the DBC; {name} has: {', '.join(known)}")

    def _feedback_by_id(self) -> dict[tuple[int, bool], Message]:
        feedback = self._profile.feedback
        motion = feedback.motion
        signals = [rule.signal for rule in (*feedback.ready, *feedback.fault, *feedback.override)]
        signals += [*motion.forward, *motion.lateral, *motion.yaw, *motion.steering]
        for path in signals:
            name, _, signal = path.partition(".")
            self._check_signals("feedback", name, {signal: 0.0})
            if name not in feedback.stale_s:
                self._refuse("feedback.stale_s", f"must give the greatest age of {name}, which is used")
        messages = [self._message("feedback.stale_s", name) for name in feedback.stale_s]
        return {(self._ids[message.name], message.is_extended_frame): message for message in messages}

    def _check_limits(self) -> None:
        """Refuse limits that would saturate on the wire: a robot that is asked for 40 m/s must not get 32."""
        speed = self._profile.limits.speed_m_s
        for name, signals in self._profile.motion.items():
            for signal_name, gains in signals.items():
                low, high = self._layouts[name].ranges[signal_name]
                needed = speed * math.hypot(gains.forward, gains.lateral)
                if not low <= -needed <= needed <= high:
                    self._refuse("limits.speed_m_s", f"{name}.{signal_name} cannot carry {speed:g} m/s")

    def _message(self, key: str, name: str) -> Message:
        if name not in self._messages:
            self._refuse(
                key, f"no message {name!r} in {self._profile.dbc}; it has: {', '.join(self._messages)}"
            )
        return self._messages[name]

    def _refuse(self, key: str, complaint: str) -> NoReturn:
        raise ConfigError(f"{self._path}: {key}: {complaint}")


def _messages(profile: Profile, path: Path) -> dict[str, Message]:
    file = path.parent / profile.dbc
    try:
        database = cantools.database.load_file(file, database_format="dbc")
    except (OSError, ValueError, Error) as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"{path}: dbc: {file} cannot be read as a DBC ({reason})") from error
    return {message.name: message for message in cast(Database, database).messages}


def _weighted(gains: Gains, motion: Motion) -> float:
    return (
        gains.forward * motion.forward_m_s
        + gains.lateral * motion.lateral_m_s
        + gains.yaw * motion.yaw_rad_s
        + gains.steering * motion.steering_rad
    )
