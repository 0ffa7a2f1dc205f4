"""The messages that a profile uses, each checked against its DBC before anything moves."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn, cast

import cantools
from cantools.database.can import Database, Message

from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import ConfigError
from firmware_bridge.can.frame import Identifier
from firmware_bridge.can.layout import Layout
from firmware_bridge.can.profile import Profile, Step
from firmware_bridge.can.reader import Reader

LARGEST_DBC = 1 << 22
"""Bytes; a whole vehicle's takes half of it."""
LONGEST_BYTES = 8
"""Of a classic CAN frame; those of CAN FD are not spoken."""


class Vocabulary(NamedTuple):
    """What is on the wire."""

    layouts: dict[str, Layout]
    """How each command is written."""
    identifiers: dict[str, Identifier]
    """Of every message used."""
    feedback: dict[Identifier, Reader]


def read_vocabulary(profile: Profile, path: Path) -> Vocabulary:
    """Read the DBC of the profile in the file ``path``, as far as the profile uses it.

    Raises:
        ConfigError: if the DBC cannot be read, lacks what the profile names, cannot carry its limits, or if
            the names do not lead to one classic frame each.
    """
    return _Reader(profile, path).read()


class _Reader:
    def __init__(self, profile: Profile, path: Path) -> None:
        self._profile = profile
        self._path = path
        self._messages = _messages(profile, path)

    def read(self) -> Vocabulary:
        layouts = self._commands()
        feedback = self._feedback()
        identifiers = self._identifiers([*layouts, *feedback])
        self._check_protection()
        self._check_limits(layouts)
        told = {identifiers[name]: Reader(self._messages[name]) for name in feedback}
        return Vocabulary(layouts, identifiers, told)

    def _commands(self) -> dict[str, Layout]:
        layouts: dict[str, Layout] = {}
        for name, signals in self._profile.motion.items():
            layouts[name] = self._command(f"motion.{name}", name, signals)
        for key, step in self._steps():
            layouts[step.message] = layout = self._command(f"{key}.signals", step.message, step.signals)
            for name, value in step.signals.items():
                low, high = layout.ranges[name]
                if not low <= value <= high:
                    self._refuse(f"{key}.signals.{name}", f"the DBC's signal cannot carry {value:g}")
        return layouts

    def _steps(self) -> Iterator[tuple[str, Step]]:
        for key, steps in (("enable", self._profile.enable), ("stop.then", self._profile.stop.then)):
            yield from ((f"{key}[{index}]", step) for index, step in enumerate(steps))

    def _command(self, key: str, name: str, signals: Iterable[str]) -> Layout:
        message = self._message(key, name, signals)
        if message.is_multiplexed():
            self._refuse(key, f"{name} is multiplexed: give the DBC a message without a multiplexer for it")
        return Layout(message)

    def _feedback(self) -> list[str]:
        feedback = self._profile.feedback
        for path in feedback.signals:
            name, _, signal = path.partition(".")
            self._message("feedback", name, (signal,))
            if name not in feedback.stale_s:
                self._refuse("feedback.stale_s", f"must give the greatest age of {name}, which is used")
        for name in feedback.stale_s:
            self._message("feedback.stale_s", name)
        return list(feedback.stale_s)

    def _identifiers(self, used: list[str]) -> dict[str, Identifier]:
        for name, frame_id in self._profile.frame_ids.items():
            bits = 29 if self._message(f"frame_ids.{name}", name).is_extended_frame else 11
            if not 0 <= frame_id < 2**bits:
                self._refuse(
                    f"frame_ids.{name}",
                    f"{frame_id:#x} does not fit the {bits} bits of its kind (bit 31 of a DBC's is not part)",
                )
        taken: dict[Identifier, str] = {}
        for name in used:
            message = self._messages[name]
            identifier = self._profile.frame_ids.get(name, message.frame_id), bool(message.is_extended_frame)
            other = taken.setdefault(identifier, name)
            key = next((f"frame_ids.{n}" for n in (name, other) if n in self._profile.frame_ids), "dbc")
            if other != name:
                self._refuse(key, f"{name} and {other} have the same identifier {identifier[0]:#x}")
            if identifier[1] and self._profile.transport == "limo_serial":
                self._refuse(key, f"{name} has an extended identifier, a limo_serial frame carries none")
        return {name: identifier for identifier, name in taken.items()}

    def _check_protection(self) -> None:
        for name, protection in self._profile.protection.items():
            if self._message(f"protection.{name}", name).length < protection.crc_byte + 2:
                self._refuse(f"protection.{name}", "the message is too short for a counter and a CRC")

    def _check_limits(self, layouts: dict[str, Layout]) -> None:
        """Refuse limits that would saturate on the wire: a robot that is asked for 40 m/s must not get 32."""
        speed = self._profile.limits.speed_m_s
        for name, signals in self._profile.motion.items():
            for signal_name, gains in signals.items():
                low, high = layouts[name].ranges[signal_name]
                needed = speed * math.hypot(gains.forward, gains.lateral)
                if not low <= -needed <= needed <= high:
                    self._refuse("limits.speed_m_s", f"{name}.{signal_name} cannot carry {speed:g} m/s")

    def _message(self, key: str, name: str, signals: Iterable[str] = ()) -> Message:
        if name not in self._messages:
            self._refuse(
                key, f"no message {name!r} in {self._profile.dbc}; it has: {', '.join(self._messages)}"
            )
        message = self._messages[name]
        known = [signal.name for signal in message.signals]
        for signal in signals:
            if signal not in known:
                self._refuse(f"{key}.{signal}", f"no such signal in the DBC; {name} has: {', '.join(known)}")
        if message.length > LONGEST_BYTES:
            self._refuse(key, f"{name} has {message.length} bytes, frames of CAN FD are not spoken")
        for number in message.signals:
            if not (math.isfinite(number.scale) and number.scale and math.isfinite(number.offset)):
                self._refuse(key, f"{name}.{number.name} has the factor {number.scale:g} in the DBC")
        return message

    def _refuse(self, key: str, complaint: str) -> NoReturn:
        raise ConfigError(f"{self._path}: {key}: {complaint}")


def _messages(profile: Profile, path: Path) -> dict[str, Message]:
    file = path.parent / profile.dbc
    try:
        content = read_regular(file, LARGEST_DBC).decode("cp1252")
        database = cantools.database.load_string(content, database_format="dbc")
    except Exception as error:  # cantools raises what its parsers do
        reason = " ".join(str(error).split())
        raise ConfigError(f"{path}: dbc: {file} cannot be read as a DBC ({reason})") from error
    return {message.name: message for message in cast(Database, database).messages}
