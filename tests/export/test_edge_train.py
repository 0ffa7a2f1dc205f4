import pytest

from export.edge_train import main


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--workers", "0"], "--workers must be at least 1"),
        (["--seed", "-1"], "--seed must not be negative"),
        (["--frames", "0"], "--frames must be at least 1"),
        (["--resume"], "no checkpoint.pt to resume"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, message, tmp_path, capsys):
    assert main(["navigation", "--out", str(tmp_path), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert not list(tmp_path.iterdir())


def test_directory_that_cannot_be_made_is_one_line(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert main(["navigation", "--out", str(tmp_path / "file" / "run")]) == 2
    error = capsys.readouterr().err
    assert error == (
        f"edge-train: --out {tmp_path}/file/run: no directory can be made there (Not a directory); "
        "choose another\n"
    )


def test_unknown_scenario_names_the_known_ones(tmp_path, capsys):
    assert main(["juggling", "--out", str(tmp_path)]) == 2
    assert "navigation" in capsys.readouterr().err


def test_help_shows_commands_to_copy(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "edge-train navigation --seed 0 --out runs/nav" in capsys.readouterr().out
