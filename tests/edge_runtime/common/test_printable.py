"""Whatever others write, a terminal shows it and does nothing else."""

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.common.printable import first_line, printable, printed


class Inner(msgspec.Struct, frozen=True):
    name: str


class Outer(msgspec.Struct, frozen=True):
    inner: Inner
    many: tuple[Inner, ...]
    counts: dict[str, int]
    number: float = 0.5


@given(st.text())
def test_no_text_is_a_command(text):
    assert printable(text).isprintable()
    assert len(printable(text)) == len(text)
    assert printable(printable(text)) == printable(text)


def test_what_has_no_end_is_cut():
    assert printable("a" * 2000) == "a" * 2000
    assert printable("a" * 100_000) == "a" * 2000 + "..."


@given(st.text(st.characters(categories=["L", "N", "P", "S"])))
def test_letters_are_left_alone(text):
    assert printable(text) == text


def test_a_record_is_printable_through_and_through():
    record = Outer(Inner("a\x1bb"), (Inner("c\r"), Inner("d")), {"e\n": 1})
    assert printed(record) == Outer(Inner("a?b"), (Inner("c?"), Inner("d")), {"e?": 1})


def test_an_error_is_one_line():
    assert first_line(ValueError("one\ntwo")) == "one"
    assert first_line(ValueError("")) == "no reason given"
    assert first_line(ValueError("\x1b" + "a" * 5000)) == "?" + "a" * 1999 + "..."
