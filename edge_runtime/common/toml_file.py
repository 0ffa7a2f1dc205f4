"""TOML tables to frozen records; every error is one line that names the file, the key and what is allowed."""

import codecs
import math
import re
import types
from pathlib import Path
from typing import Any, Final, Literal, NoReturn, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

from edge_runtime.common.regular_file import BYTE_ORDER_MARK, read_regular
from edge_runtime.common.units import unit_of
from edge_runtime.errors import ConfigError

T = TypeVar("T")
Table = dict[str, Any]
LARGEST_FILE: Final = 1 << 20
"""Bytes; a fleet of 256 robots takes a fiftieth of it."""
DEEPEST: Final = 32
"""Tables and lists within one another."""
LARGEST_INTEGER: Final = 2**63 - 1
"""What TOML asks of a reader; longer ones could not even be told."""
_LONGEST_KEY: Final = 300
"""Parts of a dotted key; one of a file's length would take a parser's time and memory by its square."""
_SHOWN: Final = 40
_DIGITS: Final = r"\d+\.?\d*(?:[eE][-+]?\d+)?"
_NUMBER_WANTED: Final = ("Expected `float", "Expected `int")
_UTF_16: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_toml(path: Path) -> Table:
    """Read a TOML file whose numbers are all finite.

    Raises:
        ConfigError: as `read_settings` and `parse_toml`.
    """
    return parse_toml(read_settings(path), path)


def read_settings(path: Path) -> bytes:
    """Read a file of settings, as it is.

    Raises:
        ConfigError: if it cannot be read, or is no regular file of up to `LARGEST_FILE` bytes.
    """
    try:
        return read_regular(path, LARGEST_FILE)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error


def parse_toml(content: bytes, path: Path) -> Table:
    """Read the content of a TOML file whose numbers are all finite.

    Raises:
        ConfigError: if it is not TOML, is nested deeper than `DEEPEST`, or holds nan, inf, an integer beyond
            `LARGEST_INTEGER` or a text that cannot be shown.
    """
    if content.startswith(_UTF_16):
        refuse(path, "", "begins with a byte-order mark of UTF-16; save it as UTF-8")
    try:
        if any(part.count(b".") > _LONGEST_KEY for part in re.split(rb"[=,{\[\n]", content)):
            raise RecursionError
        table: Table = msgspec.toml.decode(content.removeprefix(BYTE_ORDER_MARK))
    except RecursionError:
        refuse(path, "", f"is nested deeper than {DEEPEST} tables and lists")
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(f"{path}: is not TOML ({error})") from error
    _check_values(table, path, "", DEEPEST)
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
        place, inside, _ = place.rstrip("`").partition("[...]")
        if inside:
            _check_items(table, record, place, path, key)
        hint = _number_in(table, place) if complaint.startswith(_NUMBER_WANTED) else ""
        expected = _type_at(record, re.findall(r"\w+|\[", place), table)
        _refuse_place(complaint + hint, expected, place, path, key)


def _number_in(table: Any, place: str) -> str:  # noqa: ANN401
    """Say how to write a number that stands at ``place`` as a text, with its unit or in quotes alone."""
    steps = re.findall(r"\w+", place)
    for step in steps:
        table = table[int(step) if step.isdigit() else step]
    found = re.fullmatch(rf"\s*([-+]?{_DIGITS})\s*(\S*)\s*", table) if isinstance(table, str) else None
    if found is None:
        return ""
    unit = unit_of(next((step for step in reversed(steps) if not step.isdigit()), ""))
    return f"; write a number without quotes{f', in {unit}' if unit else ''}, such as {found[1]}"


def _check_items(table: Any, record: object, place: str, path: Path, key: str) -> None:  # noqa: ANN401
    """Find which item of the table at ``place`` is wrong: msgspec writes ``[...]`` for any of its keys."""
    steps, whole = re.findall(r"\w+|\[", place), table
    for step in (step for step in steps if step != "["):
        table = table[int(step) if step.isdigit() else step]
    item_type = get_args(_type_at(record, steps, whole))[1]
    for name, item in table.items():
        to_record(item, item_type, path, f"{key}{place}.{name}".lstrip("."))


def _refuse_place(complaint: str, expected: Any, place: str, path: Path, key: str) -> NoReturn:  # noqa: ANN401
    """Say what is wrong at a place such as ``.robots[0].id`` of a record, and what is allowed there."""
    allowed = ""
    if named := re.fullmatch(r"Object (missing|contains unknown).* field `(.*)`", complaint):
        place += f".{named[2]}"
        complaint = "missing" if named[1] == "missing" else "unknown key"
        names = getattr(expected, "__struct_encode_fields__", None) or map(repr, get_args(expected))
        allowed = f"; allowed: {', '.join(names)}"
    elif complaint.startswith(("Invalid enum value", "Invalid value")):
        allowed = f"; allowed: {', '.join(map(repr, get_args(expected)))}"
    refuse(path, f"{key}{place}".lstrip("."), f"{complaint}{allowed}".replace("`object`", "`table`"))


def refuse(path: Path, key: str, complaint: str) -> NoReturn:
    """Raise the ConfigError for one key of one file; an empty key is the whole file."""
    raise ConfigError(": ".join(part for part in (str(path), key, complaint) if part))


def _check_values(value: object, path: Path, key: str, depth: int) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        refuse(path, key, f"must be a finite number, got {value}")
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        refuse(path, key, f"must be an integer of 64 bits, got one of {value.bit_length()}")
    if isinstance(value, str) and not value.isprintable():
        refuse(path, key, f"holds characters that cannot be shown: {value[:_SHOWN]!a}")
    if isinstance(value, dict | list) and depth < 0:
        refuse(path, key, f"is nested deeper than {DEEPEST} tables and lists")
    if isinstance(value, dict):
        for name, item in value.items():
            _check_values(item, path, f"{key}.{name}".lstrip("."), depth - 1)
    if isinstance(value, list):
        for index, item in enumerate(value):
            _check_values(item, path, f"{key}[{index}]", depth - 1)


def _type_at(expected: Any, steps: list[str], value: Any) -> Any:  # noqa: ANN401  # types of any form
    """The type that a record has at a place; of several tagged ones, which of them ``value`` says it is.

    Where it says none of them, what it may say.
    """
    if get_origin(expected) in (Union, types.UnionType):
        expected = _option(expected, value)
    if not steps or get_origin(expected) is Literal:
        return expected
    if steps[0] == "[":
        return _type_at(get_args(expected)[0], steps[2:], value[int(steps[1])])
    return _type_at(get_type_hints(expected)[steps[0]], steps[1:], value.get(steps[0]))


def _option(union: Any, value: Any) -> Any:  # noqa: ANN401
    options = [option for option in get_args(union) if option is not type(None)]
    tagged = {
        option.__struct_config__.tag: option for option in options if hasattr(option, "__struct_config__")
    }
    if len(tagged) < 2 or not isinstance(value, dict):
        return options[0]
    said = value.get(options[0].__struct_config__.tag_field)
    return tagged[said] if isinstance(said, str) and said in tagged else Literal[tuple(tagged)]
