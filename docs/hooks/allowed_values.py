"""What a key of a file may be, learnt from the program: its own complaint about values that are absurd."""

import itertools
import re
from collections.abc import Iterator
from typing import Any, Final

import msgspec
from msgspec import inspect

Table = dict[str, Any]
_LEAST, _MOST = -1e300, 1e300
_TEXTS: Final = ("10.0.0.12:47000", "x")
"""One of them is what a text must be; where neither is, nothing can be learnt."""
_COMPLAINT: Final = re.compile(r"must (.*?)(?:, got .*|; .*|: .*)?$")
_BOUND: Final = re.compile(r"Expected `\w+` (<=|>=|<|>) (\S+)")


def allowed(kind: type[msgspec.Struct], field: inspect.Field) -> str:
    """What the record says of its field when it is given what it cannot be; empty if it takes anything."""
    table = _taken(kind)
    if table is None:
        return ""
    absurd = [{**table, field.encode_name: value} for value in _absurd(plain(field.type))]
    told = list(dict.fromkeys(filter(None, (_complaint(kind, one) for one in absurd))))
    intervals = [text for text in told if text.startswith("in ")]
    return "; ".join(intervals or told)


def plain(kind: inspect.Type) -> inspect.Type:
    """A type without the None that stands for a key left out."""
    if isinstance(kind, inspect.UnionType):
        options = [option for option in kind.types if not isinstance(option, inspect.NoneType)]
        return options[0] if len(options) == 1 else kind
    return kind


def _complaint(kind: type[msgspec.Struct], table: Table) -> str:
    try:
        msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        complaint = str(error).partition(" - at `$")[0]
        if bound := _BOUND.fullmatch(complaint):
            return f"{bound[1]} {bound[2]}"
        found = _COMPLAINT.search(complaint)
        return re.sub("^(be|lie) ", "", found[1]) if found else ""
    return ""


def _taken(kind: type[msgspec.Struct]) -> Table | None:
    """A table of required keys that the record takes; None if none was found."""
    for text in _TEXTS:
        table = _sample_table(inspect.type_info(kind), text)
        try:
            msgspec.convert(table, kind)
        except msgspec.ValidationError:
            continue
        return table
    return None


def _sample_table(kind: inspect.Type, text: str) -> Table:
    assert isinstance(kind, inspect.StructType)  # noqa: S101  # for the reader
    table = {field.encode_name: _sample(field.type, text) for field in kind.fields if field.required}
    return {**table, kind.tag_field: kind.tag} if kind.tag_field else table


def _sample(kind: inspect.Type, text: str) -> Any:  # noqa: ANN401  # a value of any type
    kind = plain(kind)
    value: Any = text
    match kind:
        case inspect.BoolType():
            value = True
        case inspect.IntType() | inspect.FloatType():
            value = 1
        case inspect.LiteralType():
            value = kind.values[0]
        case inspect.TupleType():
            value = [_sample(item, text) for item in kind.item_types]
        case inspect.VarTupleType() | inspect.ListType():
            item = _sample(kind.item_type, text)
            value = [0, 1] if item == 1 else [item]
        case inspect.DictType():
            value = {"x": _sample(kind.value_type, text)}
        case inspect.StructType():
            value = _sample_table(kind, text)
    return value


def _absurd(kind: inspect.Type) -> Iterator[Any]:
    match kind:
        case inspect.IntType():
            yield from (-1, 2**62, 0)
        case inspect.FloatType():
            yield from (_MOST, _LEAST, -1.0, 0.0)
        case inspect.StrType():
            yield from ("?", "")
        case inspect.TupleType():
            yield from (list(values) for values in zip(*map(_absurd, kind.item_types), strict=False))
        case inspect.VarTupleType():
            yield []
            yield from ([value] for value in itertools.islice(_absurd(kind.item_type), 2))
