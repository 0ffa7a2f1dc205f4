"""The JSON of a log: records to messages and back exactly, and their JSON Schemas."""

import functools
import math
import types
from typing import Any, Final, TypeVar, get_args, get_origin, get_type_hints

import msgspec

Record = TypeVar("Record", bound=msgspec.Struct)

_SCALARS: Final = {float: "number", int: "integer", str: "string", bool: "boolean"}
_NON_FINITE: Final = {math.inf: "Infinity", -math.inf: "-Infinity"}
_encode = msgspec.json.encode


def encode(record: msgspec.Struct) -> bytes:
    """Return a record as JSON; numbers that are not finite become strings, see `edge_runtime.log_schema`."""
    encoded = _encode(record)
    # msgspec writes null for what is not finite, and no record of a log has a null of its own.
    if b"null" in encoded:
        return _encode(_spelled_out(msgspec.to_builtins(record)))
    return encoded


def decoder(record: type[Record]) -> msgspec.json.Decoder[Record]:
    """Return what reads the messages that `encode` wrote.

    Its ``decode`` raises `msgspec.DecodeError` for what is not JSON, or of another shape.
    """
    return msgspec.json.Decoder(record, strict=False)  # not strict: "NaN" is a number


def json_schema(record: type[msgspec.Struct]) -> bytes:
    """Return the JSON Schema of a record, in the part of the language that Foxglove reads.

    That has no references, no nulls, no tuples and no choices: every record stands inside the one that has
    it, and a pair of numbers is an array of numbers.
    """
    return _encode({"$schema": "https://json-schema.org/draft/2020-12/schema", **_schema(record)})


def _schema(kind: Any) -> dict[str, Any]:  # noqa: ANN401  # types of any form
    if kind in _SCALARS:
        return {"type": _SCALARS[kind]}
    if get_origin(kind) is tuple:
        item, *more = get_args(kind)
        sizes = {} if more == [...] else {"minItems": 1 + len(more), "maxItems": 1 + len(more)}
        return {"type": "array", "items": _schema(item), **sizes}
    if isinstance(kind, types.GenericAlias) or not issubclass(kind, msgspec.Struct):
        raise TypeError(f"a log cannot hold {kind}")
    properties = {name: _schema(hint) for name, hint in _hints(kind).items()}
    return {"title": kind.__name__, "type": "object", "properties": properties, "required": [*properties]}


@functools.cache
def _hints(kind: type[msgspec.Struct]) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {name: hints[name] for name in kind.__struct_fields__}


def _spelled_out(value: Any) -> Any:  # noqa: ANN401  # what JSON holds
    if isinstance(value, float) and not math.isfinite(value):
        return _NON_FINITE.get(value, "NaN")
    if isinstance(value, dict):
        return {name: _spelled_out(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_spelled_out(item) for item in value]
    return value
