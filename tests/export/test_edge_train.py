import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest
from paths import ROOT
from training_runs import SETTINGS, request

from export import edge_train
from export.algorithms.mafpo_chain import MafpoChain
from export.edge_train import main, make_parser
from export.training.lock import locked
from export.training.request import check_request


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--workers", "0"], "--workers: must be a whole number in [1, "),
        (["--seed", "-1"], "--seed: must be a whole number in [0, "),
        (["--frames", "0"], "--frames: must be a whole number in [1, "),
        (["--resume"], "no checkpoint.pt to resume"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, message, tmp_path, capsys):
    assert main(["navigation", "--out", str(tmp_path), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("out", ["/proc/run", "/proc/self", "/dev/null/run", "x" * 300])
def test_directory_that_cannot_be_written_is_one_line(out, capsys):
    assert main(["navigation", "--out", out]) == 2
    error = capsys.readouterr().err
    assert re.fullmatch(
        rf"edge-train: --out {out}: nothing can be written there \([\w ]+\); choose another\n", error
    )


def test_a_second_edge_train_in_one_directory_is_refused_until_the_first_has_ended(tmp_path, capsys):
    code = (
        "import sys; from pathlib import Path; from export.training.lock import locked\n"
        "with locked(Path(sys.argv[1])): print(flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        first.stdout.readline()
        assert main(["navigation", "--out", str(tmp_path)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "another edge-train is at work there" in error
        first.kill()
    with locked(tmp_path):
        pass


TRAIN = """
import sys
sys.path.insert(0, "tests/support")
from training_runs import SETTINGS
from export.algorithms.mafpo_chain import MafpoChain
from export.edge_train import main
MafpoChain.settings = SETTINGS  # in each worker, which imports this file
if __name__ == "__main__":
    sys.exit(main(["navigation", "--out", *sys.argv[1:]]))
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_whoever_reads_no_more_ends_the_training_quietly_and_it_can_go_on(tmp_path, workers):
    (tmp_path / "train.py").write_text(TRAIN)
    command = [sys.executable, tmp_path / "train.py", tmp_path / "run", "--workers", str(workers)]
    reader, writer = os.pipe()
    os.close(reader)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, cwd=ROOT, env=environment
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")
    assert check_request(request(tmp_path / "run", resume=True), workers, SETTINGS).saved


def test_frames_are_not_rounded_in_silence(tmp_path, capsys, monkeypatch):
    trained = []
    monkeypatch.setattr(MafpoChain, "settings", replace(SETTINGS, frames=96))
    monkeypatch.setattr(edge_train, "work", trained.append)
    for frames, told in (("100", True), ("96", False)):
        assert main(["navigation", "--out", str(tmp_path), "--frames", frames]) == 0
        error = capsys.readouterr().err
        assert ("--frames 100 is rounded up to 144: an update takes 48" in error) == told
    assert [request.frames for request in trained] == [100, 96]


def test_help_tells_every_default():
    for action in make_parser()._actions:
        if action.default not in (None, False, "==SUPPRESS=="):
            assert "(default: %(default)s)" in action.help
    assert "700000, mafpo-warm: 400000" in make_parser().format_help().replace("-\n" + 24 * " ", "-")


def test_unknown_scenario_names_the_known_ones(tmp_path, capsys):
    assert main(["juggling", "--out", str(tmp_path)]) == 2
    assert "navigation" in capsys.readouterr().err


def test_help_shows_commands_to_copy(capsys):
    assert main(["--help"]) == 0
    assert "edge-train navigation --seed 0 --out runs/nav" in capsys.readouterr().out
