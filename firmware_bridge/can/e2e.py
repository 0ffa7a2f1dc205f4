"""Counters and CRCs of AUTOSAR end-to-end protection, profiles 1 and 2.

Source: AUTOSAR Foundation, "E2E Protocol Specification" and "Specification of CRC Routines". Both profiles
keep the CRC in one byte and a 4-bit counter in the low half of the next byte.
"""

from typing import Literal

import msgspec

CRC_SAE_J1850 = 0x1D
CRC_H2F = 0x2F

DataIdMode = Literal["both", "alternating", "low", "nibble"]


def _table(polynomial: int) -> bytes:
    def entry(value: int) -> int:
        for _ in range(8):
            value = (value << 1) ^ (polynomial if value & 0x80 else 0)
        return value & 0xFF

    return bytes(entry(value) for value in range(256))


_TABLES = {polynomial: _table(polynomial) for polynomial in (CRC_SAE_J1850, CRC_H2F)}


def crc8(data: bytes, polynomial: int, start: int, final_xor: int) -> int:
    """Return the unreflected 8-bit CRC of ``data``."""
    table, crc = _TABLES[polynomial], start
    for byte in data:
        crc = table[crc ^ byte]
    return crc ^ final_xor


class Protection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How one message is protected; sender and receiver share it."""

    profile: Literal["e2e_p01", "e2e_p02"]
    """AUTOSAR profile 1 or 2."""
    data_id: int = 0
    """Profile 1: 16 bits that both sides know and that are not sent, or only in part."""
    data_id_mode: DataIdMode = "both"
    """Profile 1: how the data id enters the CRC."""
    data_id_list: tuple[int, ...] = ()
    """Profile 2: 16 bytes, one for each counter value."""
    crc_byte: int = 0
    """Where the CRC stands; the counter is in the low half of the byte after it."""

    def __post_init__(self) -> None:
        if not 0 <= self.data_id <= 0xFFFF:
            raise ValueError(f"`data_id` must have 16 bits, got {self.data_id:#x}")
        if not 0 <= self.crc_byte <= 6:
            raise ValueError(f"`crc_byte` must lie in [0, 6], got {self.crc_byte}")
        if self.profile == "e2e_p02" and (
            len(self.data_id_list) != 16 or not all(0 <= byte <= 0xFF for byte in self.data_id_list)
        ):
            raise ValueError("`data_id_list` must have 16 bytes for e2e_p02")
        if self.profile == "e2e_p02" and self.crc_byte != 0:
            raise ValueError("`crc_byte` must be 0 for e2e_p02")

    @property
    def counters(self) -> int:
        """How many counter values there are before it starts again at 0."""
        return 15 if self.profile == "e2e_p01" else 16


def protect(data: bytes, counter: int, protection: Protection) -> bytes:
    """Return ``data`` with this counter, and the CRC over it, written in."""
    protected = bytearray(data)
    place = protection.crc_byte + 1
    protected[place] = protected[place] & 0xF0 | counter
    if protection.data_id_mode == "nibble" and protection.profile == "e2e_p01":
        protected[place] = counter | (protection.data_id >> 8 & 0x0F) << 4
    protected[protection.crc_byte] = _crc(bytes(protected), counter, protection)
    return bytes(protected)


def counter_of(data: bytes, protection: Protection) -> int | None:
    """Return the counter of protected data, or None where CRC or counter are wrong."""
    if len(data) <= protection.crc_byte + 1:
        return None
    counter = data[protection.crc_byte + 1] & 0x0F
    right = counter < protection.counters and _crc(data, counter, protection) == data[protection.crc_byte]
    return counter if right else None


def _crc(data: bytes, counter: int, protection: Protection) -> int:
    place = protection.crc_byte
    rest = data[:place] + data[place + 1 :]
    if protection.profile == "e2e_p02":
        return crc8(rest + bytes([protection.data_id_list[counter]]), CRC_H2F, 0xFF, 0xFF)
    return crc8(_data_id_bytes(counter, protection) + rest, CRC_SAE_J1850, 0x00, 0x00)


def _data_id_bytes(counter: int, protection: Protection) -> bytes:
    low, high = protection.data_id & 0xFF, protection.data_id >> 8
    if protection.data_id_mode == "both":
        return bytes([low, high])
    if protection.data_id_mode == "alternating":
        return bytes([low if counter % 2 == 0 else high])
    return bytes([low]) if protection.data_id_mode == "low" else bytes([low, 0])
