"""What every command's parser holds to."""

import os
from pathlib import Path

import pytest

from edge_runtime.common.command_line import CommandParser, check_output
from edge_runtime.errors import ConfigError
from edge_runtime.run.edge_run import main


def test_a_path_must_name_something():
    parser = CommandParser("edge-x")
    parser.add_argument("--log-dir", type=Path)
    assert parser.parse_args(["--log-dir", "logs"]).log_dir == Path("logs")
    with pytest.raises(ConfigError, match="argument --log-dir: is empty, it must name a file or folder"):
        parser.parse_args(["--log-dir", ""])


@pytest.mark.parametrize("flag", ["--log-dir", "--json", "--fleet", "--policy", "--objectives", "--animate"])
def test_edge_run_takes_no_empty_path_for_the_current_folder(flag, capsys):
    assert main(["--robot-id", "0", flag, ""]) == 2
    assert f"argument {flag}: is empty" in capsys.readouterr().err


def test_what_cannot_be_written_is_refused_before_the_work_and_waits_for_nobody(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name in ("pipe", "loop", "no/file", "a" * 300, ""):
        with pytest.raises(ConfigError, match=r"^--json .*: cannot be written \(.+\)$"):
            check_output("--json", tmp_path / name, ())


def test_a_file_that_is_read_is_not_written(tmp_path):
    (tmp_path / "fleet.toml").touch()
    (tmp_path / "other").symlink_to(tmp_path / "fleet.toml")
    with pytest.raises(ConfigError, match="would overwrite a file that is read"):
        check_output("--json", tmp_path / "other", (None, tmp_path / "fleet.toml"))
