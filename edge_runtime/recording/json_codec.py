"""The JSON of a log: records to messages and back exactly, and their JSON Schemas."""

import math
import types
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

Record = TypeVar("Record", bound=msgspec.Struct)

_SCALARS: Final = {float: "number", int: "integer", str: "string", bool: "boolean"}
_NON_FINITE: Final = {math.inf: "Infinity", -math.inf: "-Infinity"}
_encode = msgspec.json.encode


def encode(record: msgspec.Struct) -> bytes:
    """Return a record as JSON: what is None is left out, a number that is not finite becomes a string."""
    encoded = _encode(record)
    if b"null" in encoded:  # msgspec writes it for both, or it is part of a text
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
    if get_origin(kind) is Literal:
        return {"type": "string"}
    if get_origin(kind) is tuple:
        item, *more = get_args(kind)
        sizes = {} if more == [...] else {"minItems": 1 + len(more), "maxItems": 1 + len(more)}
        return {"type": "array", "items": _schema(item), **sizes}
    if not (isinstance(kind, type) and issubclass(kind, msgspec.Struct)):
        raise TypeError(f"a log cannot hold {kind}")
    hints = get_type_hints(kind)
    fields = {name: hints[name] for name in kind.__struct_fields__}
    required = [name for name, hint in fields.items() if _present(hint) is hint]
    properties = {name: _schema(_present(hint)) for name, hint in fields.items()}
    return {"title": kind.__name__, "type": "object", "properties": properties, "required": required}


def _present(hint: Any) -> Any:  # noqa: ANN401  # types of any form
    """What an optional field holds if it holds anything; another field's type as it is."""
    if get_origin(hint) not in (types.UnionType, Union):
        return hint
    (present,) = (option for option in get_args(hint) if option is not types.NoneType)
    return present


def _spelled_out(value: Any) -> Any:  # noqa: ANN401  # what JSON holds
    if isinstance(value, float) and not math.isfinite(value):
        return _NON_FINITE.get(value, "NaN")
    if isinstance(value, dict):
        return {name: _spelled_out(item) for name, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_spelled_out(item) for item in value]
    return value
