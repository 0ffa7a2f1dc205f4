"""Tables of a file's keys, made from the records that read it: type, unit, default, what is allowed."""

import functools
import inspect as python_inspect
import logging
import math
import re
import types
from collections.abc import Iterable, Mapping
from typing import Final, get_args

import griffe
import msgspec
from allowed_values import allowed, plain
from msgspec import inspect

_LOG: Final = logging.getLogger("mkdocs.hooks.record_tables")
UNITS: Final = {
    "m_s2": "m/s²", "m_s": "m/s", "rad_s": "rad/s", "rad": "rad", "per_s": "1/s", "kg": "kg", "hz": "Hz",
    "ms": "ms", "mib": "MiB", "cores": "cores", "periods": "control periods", "share": "share of 1",
    "m": "m", "s": "s",
}  # fmt: skip
"""By the end of a key; the first that fits."""
_HEAD: Final = "| key | type, unit | default | allowed | what it says |\n|---|---|---|---|---|\n"
_WORDS: Final = {
    inspect.FloatType: "number", inspect.IntType: "whole number", inspect.StrType: "text",
    inspect.BoolType: "true or false", inspect.AnyType: "anything",
}  # fmt: skip


def file_tables(record: type[msgspec.Struct]) -> str:
    """Every table of the file that a record reads, each under the name that it has in the file."""
    return "\n\n".join(_tables(record, "", "", {}))


def kind_tables(kinds: Iterable[type[msgspec.Struct]] | types.UnionType) -> str:
    """A table for each of several records, or of those that a key may be, under its tag."""
    if isinstance(kinds, types.UnionType):
        kinds = get_args(kinds)
    return "\n\n".join(
        f"### `{kind.__struct_config__.tag}`\n\n{_about(kind)}\n\n{_table(kind, _fields(kind))}"
        for kind in kinds
    )


def channel_tables(channels: Mapping[str, tuple[str, type[msgspec.Struct]]]) -> str:
    """A table for each channel of a log: its record's keys, which nobody but the runtime writes."""
    return "\n\n".join(_channel(name, schema, kind) for name, (schema, kind) in channels.items())


def _channel(name: str, schema: str, kind: type[msgspec.Struct]) -> str:
    docs = _docs(kind)
    rows = [(f"`{one.encode_name}`", _measure(one), docs.get(one.name, "")) for one in _fields(kind)]
    table = "| key | type, unit | what it says |\n|---|---|---|\n" + "\n".join(map(_cells, rows))
    return f"### `/{name}`\n\n{_about(kind)} Schema `{schema}`.\n\n{table}"


def _about(kind: type) -> str:
    """What a record's docstring says of it, without its sections for programmers."""
    return _text(re.split(r"\n(?:Raises|Args):", python_inspect.cleandoc(kind.__doc__ or ""))[0])


def _tables(record: type[msgspec.Struct], path: str, heading: str, told: dict[type, str]) -> list[str]:
    """The table of a record, then of those within it; one that was described already is named."""
    fields = _fields(record)
    inners = [(field, _inner(plain(field.type))) for field in fields]
    own = [field for field, inner in inners if inner is None]
    text = f"### {heading}\n\n{_about(record)}\n\n" if heading else ""
    parts = [text + (_table(record, own) if own else "")] if text or own else []
    for field, inner in inners:
        if inner is not None and inner[0] is None:
            heading = inner[1].format(field.encode_name)
            parts.append(f"### `{heading}`\n\n{_text(_docs(record).get(field.name, ''))}")
        elif inner is not None:
            place = inner[1].format(f"{path}.{field.encode_name}".lstrip("."))
            parts += _nested(_docs(record).get(field.name, ""), inner[0].cls, place, told)
    return parts


def _nested(what: str, kind: type[msgspec.Struct], heading: str, told: dict[type, str]) -> list[str]:
    title = f"`{heading}`"
    if kind in told:
        return [f"### {title}\n\n{_text(what)} Keys as in {told[kind]}."]
    told[kind] = title
    return _tables(kind, heading.strip("[]"), title, told)


def _inner(kind: inspect.Type) -> tuple[inspect.StructType | None, str] | None:
    """The record of a table, and how its heading is written; None for a plain value.

    The record is None for a table whose keys another key decides.
    """
    kind = plain(kind)
    match kind:
        case inspect.DictType(value_type=inspect.AnyType()):
            return None, "[{}]"
        case inspect.StructType():
            return kind, "[{}]"
        case inspect.VarTupleType() | inspect.ListType():
            found = _inner(kind.item_type)
            return found and (found[0], "[[{}]]")
        case inspect.DictType():
            found = _inner(kind.value_type)
            return found and (found[0], found[1].replace("{}", "{}.NAME"))
    return None


def _table(record: type[msgspec.Struct], fields: Iterable[inspect.Field]) -> str:
    rows = [_row(record, field) for field in fields]
    return _HEAD + "\n".join(rows) if rows else "No keys of its own."


def _row(record: type[msgspec.Struct], field: inspect.Field) -> str:
    docs = _docs(record)
    if not docs.get(field.name):
        _LOG.warning(
            "%s.%s has no docstring: the reference cannot say what it is", record.__name__, field.name
        )
    what = docs.get(field.name, "")
    return _cells((f"`{field.encode_name}`", _measure(field), _default(field), allowed(record, field), what))


def _cells(texts: Iterable[str]) -> str:
    return "| " + " | ".join(_text(text).replace("|", "\\|") for text in texts) + " |"


def _measure(field: inspect.Field) -> str:
    unit = next((unit for end, unit in UNITS.items() if re.search(rf"(^|_){end}$", field.encode_name)), "")
    return ", ".join(filter(None, (_type(field.type), unit)))


def _type(kind: inspect.Type) -> str:
    kind = plain(kind)
    words = _WORDS.get(type(kind), "table")
    match kind:
        case inspect.LiteralType():
            words = " or ".join(f"`{msgspec.json.encode(value).decode()}`" for value in kind.values)
        case inspect.TupleType():
            words = f"{len(kind.item_types)} {_plural(kind.item_types[0])}"
        case inspect.VarTupleType() | inspect.ListType():
            words = f"list of {_plural(kind.item_type)}"
        case inspect.DictType():
            words = f"table of {_plural(kind.value_type)}"
        case inspect.UnionType():
            words = " or ".join(dict.fromkeys(map(_type, kind.types)))
    return words


def _plural(kind: inspect.Type) -> str:
    words = _type(kind)
    many = isinstance(
        plain(kind), inspect.TupleType | inspect.VarTupleType | inspect.LiteralType | inspect.BoolType
    )
    return words if many else f"{words}s"


def _default(field: inspect.Field) -> str:
    if field.required:
        return "required"
    value = field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
    if value is None or value in ((), {}, math.inf):
        return ""
    return f"`{msgspec.json.encode(value).decode()}`"


def _fields(record: type[msgspec.Struct]) -> tuple[inspect.Field, ...]:
    kind = inspect.type_info(record)
    assert isinstance(kind, inspect.StructType)  # noqa: S101  # for the reader
    return kind.fields


def _docs(record: type) -> dict[str, str]:
    """What stands below each field, in the class or in those that it extends."""
    found: dict[str, str] = {}
    for kind in reversed(record.__mro__):
        if kind.__module__ not in ("builtins", "msgspec._core", "msgspec", "abc"):
            members = _module(kind.__module__)[kind.__qualname__].members
            found |= {name: one.docstring.value for name, one in members.items() if one.docstring}
    return found


@functools.cache
def _module(name: str) -> griffe.Module:
    loaded = griffe.load(name, resolve_aliases=False)
    assert isinstance(loaded, griffe.Module)  # noqa: S101  # for the type checker
    return loaded


def _text(docstring: str) -> str:
    """A docstring in one line of Markdown; what is None in a record is left out of a file."""
    line = " ".join(docstring.split()).replace("``", "`")
    line = re.sub(r"\bNone\b", "left out", line)
    return re.sub(r"`(?:\w+\.)*(\w+\.\w+)`", r"`\1`", line)
