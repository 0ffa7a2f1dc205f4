"""Files that users name hold nothing up and have an end, whatever the name leads to."""

import errno
import os
from pathlib import Path

import pytest

from edge_runtime.common.regular_file import open_regular, read_regular


def complaint(path, largest=100):
    with pytest.raises(OSError) as caught:
        read_regular(Path(path), largest)
    return caught.value.strerror


def test_content_is_read_as_it_is(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(bytes(range(100)))
    assert read_regular(file, 100) == bytes(range(100))
    with open_regular(file, 100) as opened:
        assert opened.read(3) == b"\0\1\2"


def test_one_byte_too_many(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(bytes(101))
    assert complaint(file) == "101 bytes, at most 100 are read"


def test_what_never_ends_or_never_begins(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", "/dev/full"):
        assert complaint(path) == "not a regular file"


def test_files_of_the_systems_own_have_no_size():
    assert complaint("/proc/self/status") == "not a regular file"


def test_an_empty_file_is_one(tmp_path):
    (tmp_path / "empty").touch()
    assert read_regular(tmp_path / "empty", 0) == b""


def test_what_is_missing_is_told_as_the_system_does(tmp_path):
    assert complaint(tmp_path / "none") == os.strerror(errno.ENOENT)
    assert complaint(tmp_path) == os.strerror(errno.EISDIR)


@pytest.mark.parametrize("name", ["a\0b", "half \ud800"])
def test_names_that_no_file_can_have(tmp_path, name):
    assert complaint(tmp_path / name) == "no file can have this name"


def test_a_name_that_is_no_text(tmp_path):
    name = tmp_path / os.fsdecode(b"\xff\xfe")
    name.write_bytes(b"x")
    assert read_regular(name, 1) == b"x"
