"""Keys: what is read, and the one line that says what is wrong with the file."""

import os

import pytest

from edge_runtime.common.key_file import read_key
from edge_runtime.errors import ConfigError

KEY = bytes(range(32))
HEX = KEY.hex()


@pytest.fixture
def write(tmp_path):
    def write_file(content, mode=0o600):
        path = tmp_path / "team.key"
        path.write_bytes(content)
        path.chmod(mode)
        return path

    return write_file


@pytest.mark.parametrize(
    "content",
    [KEY, KEY.hex().encode(), f"  {KEY.hex().upper()}\n".encode(), f"\ufeff{KEY.hex()}\r\n".encode()],
)
def test_raw_and_hexadecimal_keys(write, content):
    assert read_key(write(content)) == KEY
    assert read_key(write(content, 0o400)) == KEY


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602, 0o610, 0o644])
def test_keys_open_to_others(write, mode):
    with pytest.raises(ConfigError, match=r"team.key is open to other users; run: chmod 600 .*team.key$"):
        read_key(write(KEY, mode))


@pytest.mark.parametrize(
    "content", [b"", KEY[:-1], KEY + b"\n", KEY.hex().encode()[:-2], b"x" * 64, b"\xff" * 64, KEY * 99]
)
def test_files_that_are_no_keys(write, content):
    with pytest.raises(ConfigError, match=r"team.key is neither 32 raw bytes nor 64 hexadecimal digits$"):
        read_key(write(content))


@pytest.mark.parametrize("content", [bytes(32), b"00" * 32])
def test_a_key_of_zeros_is_no_secret(write, content):
    with pytest.raises(ConfigError, match=r"team.key is all zeros, no secret; create one with: .*openssl"):
        read_key(write(content))


def test_a_missing_key_says_how_to_make_one(tmp_path):
    with pytest.raises(
        ConfigError, match=r"No such file or directory; create it with: .*openssl rand -hex 32"
    ):
        read_key(tmp_path / "team.key")
    with pytest.raises(ConfigError, match="Is a directory"):
        read_key(tmp_path)


def test_a_pipe_is_no_key(tmp_path):
    os.mkfifo(tmp_path / "team.key")
    with pytest.raises(ConfigError, match=r"team.key: not a regular file"):
        read_key(tmp_path / "team.key")


def test_a_key_of_another_user(write, monkeypatch):
    path = write(KEY)
    if os.geteuid() == 0:
        os.chown(path, 12345, -1)
        owner = 12345
    else:
        owner = os.geteuid()
        monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(ConfigError, match=f"belongs to user {owner}; run: chown"):
        read_key(path)
