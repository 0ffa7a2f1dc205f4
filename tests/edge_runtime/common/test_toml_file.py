"""TOML files of any content become tables, or one line, in bounded time."""

import os
from pathlib import Path

import msgspec
import pytest

from edge_runtime.common.toml_file import parse_toml, read_toml, to_record
from edge_runtime.errors import ConfigError

FILE = Path("team.toml")
DEEP = "is nested deeper than 32 tables and lists"


def refusal(content):
    with pytest.raises(ConfigError) as caught:
        parse_toml(content, FILE)
    file, _, rest = str(caught.value).partition(": ")
    assert file == str(FILE)
    assert "\n" not in rest
    return rest


@pytest.mark.parametrize("content", [
    b"a = " + b"[" * 100_000 + b"]" * 100_000,
    b"a = " + b"{b=" * 100_000 + b"1" + b"}" * 100_000,
    b"a." * 100_000 + b"a = 1",
    b"[" + b"a." * 100_000 + b"a]",
    b"x = {" + b"a." * 100_000 + b"a = 1}",
    b'"a".' * 100_000 + b"a = 1",
])  # fmt: skip
def test_what_is_nested_a_hundred_thousand_deep(content):
    assert refusal(content) == DEEP


def test_the_depth_that_is_stated():
    assert parse_toml(b"a = " + b"[" * 32 + b"]" * 32, FILE)
    assert refusal(b"a = " + b"[" * 33 + b"]" * 33).endswith(DEEP)
    assert parse_toml(b"a." * 32 + b"a = 1", FILE)
    assert refusal(b"a." * 33 + b"a = 1").endswith(DEEP)


@pytest.mark.parametrize("digits", [b"9" * 30, b"-" + b"9" * 30, b"9" * 500_000, b"0x" + b"f" * 500_000])
def test_integers_of_more_than_64_bits(digits):
    assert refusal(b"a = 1\nb = [1, " + digits + b"]").startswith(("b[1]: must be an integer", "is not TOML"))


def test_numbers_that_are_not_finite():
    assert refusal(b"a = [{b = nan}]") == "a[0].b: must be a finite number, got nan"


def test_a_byte_order_mark_is_passed_over():
    assert parse_toml(b"\xef\xbb\xbfa = 1", FILE) == {"a": 1}


@pytest.mark.parametrize("mark", [b"\xff\xfe", b"\xfe\xff"])
def test_the_byte_order_mark_of_another_encoding_is_named(mark):
    assert refusal(mark + b"a\0 \0=\0 \x001\0") == "begins with a byte-order mark of UTF-16; save it as UTF-8"


class Limits(msgspec.Struct):
    limit_m_s: float = 1.0
    weight: float = 1.0
    count: int | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)


@pytest.mark.parametrize(("content", "expected"), [
    ({"limit_m_s": "0.2 m/s"}, ("limit_m_s", "float", ", in m/s, such as 0.2")),
    ({"limit_m_s": "-3e-1"}, ("limit_m_s", "float", ", in m/s, such as -3e-1")),
    ({"weight": "2"}, ("weight", "float", ", such as 2")),
    ({"count": "3 pieces"}, ("count", "int | null", ", such as 3")),
    ({"centre_m": [1.0, "2 m"]}, ("centre_m[1]", "float", ", in m, such as 2")),
])  # fmt: skip
def test_a_number_in_quotes_is_told_its_unit(content, expected):
    with pytest.raises(ConfigError) as caught:
        to_record(content, Limits, FILE, "a")
    key, kind, hint = expected
    told = f"Expected `{kind}`, got `str`; write a number without quotes{hint}"
    assert str(caught.value) == f"{FILE}: a.{key}: {told}"


def test_a_text_that_is_no_number_is_told_only_what_is_wanted():
    with pytest.raises(ConfigError, match=r"weight: Expected `float`, got `str`$"):
        to_record({"weight": "much"}, Limits, FILE)


def test_files_that_are_no_settings(tmp_path):
    def complaint(path):
        with pytest.raises(ConfigError) as caught:
            read_toml(path)
        return str(caught.value).removeprefix(f"{path}: cannot be read ")

    (tmp_path / "huge.toml").write_bytes(b"#" * (2**20 + 1))
    assert complaint(tmp_path / "huge.toml") == "(1048577 bytes, at most 1048576 are read)"
    (tmp_path / "huge.toml").write_bytes(b"#" * 2**20)
    assert read_toml(tmp_path / "huge.toml") == {}
    os.mkfifo(tmp_path / "pipe")
    assert complaint(tmp_path / "pipe") == "(not a regular file)"
    assert complaint(Path("/dev/zero")) == "(not a regular file)"
    assert complaint(tmp_path / "a\0b") == "(no file can have this name)"
