"""TOML tables to frozen records; every error is one line that names the file, the key and what is allowed."""

import math
import re
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal, NoReturn, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

from edge_runtime.errors import ConfigError

T = TypeVar("T")
Table = dict[str, Any]
LARGEST_FILE: Final = 1 << 20
"""A fleet of a thousand robots takes a tenth of it."""


def read_toml(path: Path) -> Table:
    """Read a TOML file whose numbers are all finite.

    Raises:
        ConfigError: as `read_settings` and `parse_toml`.
    """
    return parse_toml(read_settings(path), path)


def read_settings(path: Path) -> bytes:
    """Read a file of settings, as it is.

    Raises:
        ConfigError: if it cannot be read, or is no ordinary file of up to `LARGEST_FILE` bytes.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would hold up who opens it
            raise ConfigError(f"{path}: is not an ordinary file")
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    if len(content) > LARGEST_FILE:
        raise ConfigError(f"{path}: is larger than {LARGEST_FILE} bytes, no file of settings is")
    return content


def parse_toml(content: bytes, path: Path) -> Table:
    """Read the content of a TOML file whose numbers are all finite.

    Raises:
        ConfigError: if it is not TOML, or holds nan or inf.
    """
    try:
        table: Table = msgspec.toml.decode(content)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not TOML ({error})") from error
    _refuse_non_finite(table, path, "")
    return table


def to_record(table: object, record: type[T], path: Path, key: str = "") -> T:
    """Convert what TOML holds at ``key`` of the file into a record.

    Raises:
        ConfigError: names the file, the dotted key and the types, values or keys allowed there.
    """
    try:
        return msgspec.convert(table, record)
    except msgspec.ValidationError as error:
        complaint, _, place = str(error).partition(" - at `$")
        _refuse_place(complaint, record, place.rstrip("`"), path, key)


def _refuse_place(complaint: str, record: object, place: str, path: Path, key: str) -> NoReturn:
    """Say what is wrong at a place such as ``.robots[0].id`` of a record, and what is allowed there."""
    expected = _type_at(record, re.findall(r"\w+|\[", place))
    allowed = ""
    if named := re.fullmatch(r"Object (missing|contains unknown).* field `(.*)`", complaint):
        place += f".{named[2]}"
        complaint = "missing" if named[1] == "missing" else "unknown key"
        allowed = f"; allowed: {', '.join(expected.__struct_encode_fields__)}"
    elif complaint.startswith("Invalid enum value"):
        allowed = f"; allowed: {', '.join(map(repr, get_args(expected)))}"
    refuse(path, f"{key}{place}".lstrip("."), f"{complaint}{allowed}".replace("`object`", "`table`"))


def refuse(path: Path, key: str, complaint: str) -> NoReturn:
    """Raise the ConfigError for one key of one file; an empty key is the whole file."""
    raise ConfigError(": ".join(part for part in (str(path), key, complaint) if part))


def _refuse_non_finite(value: object, path: Path, key: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        refuse(path, key, f"must be a finite number, got {value}")
    if isinstance(value, Mapping):
        for name, item in value.items():
            _refuse_non_finite(item, path, f"{key}.{name}".lstrip("."))
    if isinstance(value, list):
        for index, item in enumerate(value):
            _refuse_non_finite(item, path, f"{key}[{index}]")


def _type_at(expected: Any, steps: list[str]) -> Any:  # noqa: ANN401  # types of any form
    if get_origin(expected) in (Union, types.UnionType):
        expected = next(option for option in get_args(expected) if option is not type(None))
    if not steps or get_origin(expected) is Literal:
        return expected
    if steps[0] == "[":
        return _type_at(get_args(expected)[0], steps[2:])
    return _type_at(get_type_hints(expected)[steps[0]], steps[1:])
