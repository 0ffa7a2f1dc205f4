"""Secret keys in files of their own: never in TOML, never open to other users."""

import os
import stat
from pathlib import Path
from typing import Final

from edge_runtime.common.regular_file import BYTE_ORDER_MARK, open_regular
from edge_runtime.errors import ConfigError

KEY_BYTES: Final = 32
LARGEST_FILE: Final = 1 << 20
_CREATE: Final = "(umask 077 && openssl rand -hex 32 > {})"


def read_key(path: Path) -> bytes:
    """Read a key: 32 raw bytes, or 64 hexadecimal digits with white space around them.

    Raises:
        ConfigError: if the file is missing, belongs to or is open to other users, or is not a key.
    """
    try:
        content = read_private(path, 4 * KEY_BYTES)
    except OSError as error:
        raise ConfigError(f"key {path}: {error.strerror}; create it with: {_CREATE.format(path)}") from error
    return _parse(content, path)


def read_private(path: Path, size: int) -> bytes:
    """Read up to ``size`` bytes of a file that is nobody else's.

    Raises:
        OSError: if it cannot be read.
        ConfigError: if it belongs to or is open to other users.
    """
    with open_regular(path, LARGEST_FILE) as file:
        status = os.fstat(file.fileno())
        content = file.read(size)
    if status.st_uid not in (0, os.geteuid()):
        raise ConfigError(f"key {path} belongs to user {status.st_uid}; run: chown {os.geteuid()} {path}")
    if status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"key {path} is open to other users; run: chmod 600 {path}")
    return content


def _parse(content: bytes, path: Path) -> bytes:
    key = content if len(content) == KEY_BYTES else _from_digits(content)
    if len(key) != KEY_BYTES:
        raise ConfigError(
            f"key {path} is neither {KEY_BYTES} raw bytes nor {2 * KEY_BYTES} hexadecimal digits"
        )
    if not any(key):
        raise ConfigError(f"key {path} is all zeros, no secret; create one with: {_CREATE.format(path)}")
    return key


def _from_digits(content: bytes) -> bytes:
    try:
        return bytes.fromhex(content.removeprefix(BYTE_ORDER_MARK).decode("ascii"))
    except ValueError:
        return b""
