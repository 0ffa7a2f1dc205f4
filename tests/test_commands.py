"""Every command of pyproject.toml: its help, one line for a wrong flag, python -m, shell completion."""

import importlib.util
import os
import re
import subprocess
import sys

import pytest
from paths import ROOT

from edge_runtime.completion.completion import MODULES, script

PYPROJECT = (ROOT / "pyproject.toml").read_text()
SCRIPTS = dict(re.findall(r'^(edge-\w+) = "(.+):main"$', PYPROJECT, re.MULTILINE))
WORKSTATION = ("export.edge_train", "export.edge_export")
if importlib.util.find_spec("torch") is None:
    SCRIPTS = {name: module for name, module in SCRIPTS.items() if module not in WORKSTATION}


def run(module, *flags, **environment):
    command = [sys.executable, "-m", module, *flags]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )


@pytest.fixture(scope="module", params=SCRIPTS.items(), ids=list(SCRIPTS))
def helped(request):
    name, module = request.param
    return name, module, run(module, "--help", COLUMNS="100", FORCE_COLOR="1", NO_COLOR="1")


def test_help_shows_examples_and_exit_codes(helped):
    name, _, done = helped
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"usage: {name} ")
    codes = re.search(r"\nexit codes:\n((?:  +.*\n)+)", done.stdout)
    assert {"0", "2"} <= set(re.findall(r"^  (\d+)  ", codes[1], re.MULTILINE))
    examples = re.search(r"\nexamples:\n((?:  .*\n?)+)", done.stdout)
    assert name in examples[1]
    assert "\x1b" not in done.stdout


def test_a_package_of_a_command_is_the_command(helped):
    name, module, done = helped
    package, _, last = module.rpartition(".")
    if last != "command":
        pytest.skip("a module of its own")
    by_package = run(package, "--help", COLUMNS="100", FORCE_COLOR="1", NO_COLOR="1")
    assert (by_package.returncode, by_package.stdout) == (0, done.stdout)
    assert by_package.stdout.startswith(f"usage: {name} ")


def test_a_wrong_flag_is_one_line_and_exit_code_2(helped):
    name, module, _ = helped
    done = run(module, "--no-such-flag")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{name}: ")
    assert done.stderr.count("\n") == 1


def test_every_command_completes():
    bridged = {"edge-run": "edge_runtime.run.edge_run", "edge-doctor": "edge_runtime.doctor.edge_doctor"}
    assert SCRIPTS.items() <= (MODULES | bridged).items()


@pytest.mark.parametrize(
    "words, expected", [(["edge-run", "--bri"], "--bridge"), (["edge-run", "--bridge", "ma"], "mavlink")]
)
def test_bash_completes_flags_and_choices(tmp_path, words, expected):
    pytest.importorskip("shtab")
    (tmp_path / "complete.bash").write_text(script("bash"))
    asked = (
        f"source complete.bash; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _shtab_edge_run"
    )
    done = subprocess.run(
        ["bash", "-c", f'{asked}; echo "${{COMPREPLY[@]}}"'],
        capture_output=True, text=True, check=True, cwd=tmp_path,
    )  # fmt: skip
    assert done.stdout.split() == [expected]
