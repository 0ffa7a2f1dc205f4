"""Files that a writer replaces: whole, and the old version where it fails."""

import errno
import os

import pytest

from edge_runtime.common.durable_file import replace_durably


def test_a_file_is_replaced_and_nothing_else_stays(tmp_path):
    path = tmp_path / "file"
    for content in (b"old", b"new"):
        replace_durably(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_leaves_the_old_version_alone(tmp_path, monkeypatch):
    path = tmp_path / "file"
    replace_durably(path, b"old")

    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(OSError, match="No space left"):
        replace_durably(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
