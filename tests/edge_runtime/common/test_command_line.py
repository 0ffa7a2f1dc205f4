"""What every command's parser holds to."""

from pathlib import Path

import pytest

from edge_runtime.common.command_line import CommandParser
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
