"""Every command: its help, python -m, completion, and one line for whatever goes wrong around it."""

import importlib.util
import os
import re
import subprocess
import sys
from functools import partial

import pytest
from logs import record
from paths import ROOT
from ports import free_port

import edge_runtime
from edge_runtime.common.commands import COMMANDS
from edge_runtime.completion.completion import script

PYPROJECT = (ROOT / "pyproject.toml").read_text()
WORKSTATION = ("edge-train", "edge-export")
SCRIPTS = {
    name: module
    for name, module in COMMANDS.items()
    if name not in WORKSTATION or importlib.util.find_spec("torch") is not None
}


def run(module, *flags, **environment):
    command = [sys.executable, "-m", module, *flags]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )


@pytest.fixture(scope="module", params=SCRIPTS.items(), ids=list(SCRIPTS))
def helped(request):
    name, module = request.param
    return name, module, run(module, "--help", COLUMNS="100", FORCE_COLOR="1", NO_COLOR="1")


@pytest.mark.parametrize("name", WORKSTATION)
def test_a_robot_without_the_workstations_extra_is_told_which(name):
    code = "import sys; sys.modules['torch'] = None; from edge_runtime.common import commands; commands.{}()"
    done = subprocess.run(
        [sys.executable, "-c", code.format(name.replace("-", "_"))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"{name}: torch is not installed; run: pip install 'cfpg-edge[train]'\n"


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
    _, module, done = helped
    package = module.rpartition(".")[0]
    if importlib.util.find_spec(f"{package}.__main__") is None:
        pytest.skip("several commands of one package")
    by_package = run(package, "--help", COLUMNS="100", FORCE_COLOR="1", NO_COLOR="1")
    assert (by_package.returncode, by_package.stdout) == (0, done.stdout)


def test_a_wrong_flag_is_one_line_and_exit_code_2(helped):
    name, module, _ = helped
    done = run(module, "--no-such-flag")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{name}: ")
    assert done.stderr.count("\n") == 1


def test_every_command_has_an_installed_script():
    scripts = dict(
        re.findall(r'^(edge-\w+) = "edge_runtime\.common\.commands:(\w+)"$', PYPROJECT, re.MULTILINE)
    )
    assert scripts == {name: name.replace("-", "_") for name in COMMANDS}


def script_of(name, before=""):
    """What an installed script does, after ``before``."""
    return [sys.executable, "-c", f"{before}\nfrom edge_runtime.common.commands import {name} as go; go()"]


@pytest.fixture(params=[name for name in SCRIPTS if name not in WORKSTATION])
def name(request):
    """Those that load at once: the frame is the same for all."""
    return request.param.replace("-", "_")


def shell(command, sinks, cwd=None):
    """Run a command whose streams go where a shell's redirections say."""
    line = ["bash", "-c", f'"$@" {sinks}', "bash", *map(str, command)]
    done = subprocess.run(line, capture_output=True, text=True, check=False, cwd=cwd)
    return done.returncode, done.stdout, done.stderr


def test_a_reader_that_stops_reading_is_no_error(name):
    code, shown, said = shell([*script_of(name), "--help"], "| true; exit ${PIPESTATUS[0]}")
    assert (code in (0, 1), shown, said) == (True, "", "")  # 1 where the text was cut


@pytest.mark.parametrize(
    "words",
    ["benchmarks latency -h", "edge_runtime.completion bash", "export.train_all -h", "export.edge_train -h"],
)
def test_no_reader_at_all_is_no_error_of_a_module_either(words):
    module, *flags = words.split()
    if module.startswith("export"):
        pytest.importorskip("torch")
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", module, *flags]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, cwd=ROOT)
    os.close(writer)
    assert done.returncode in (0, 1, 2)  # 2 where shtab is not installed
    assert "Traceback" not in done.stderr and done.stderr.count("\n") <= 1


@pytest.mark.parametrize("stream", ["stdout", "both"])
def test_streams_that_were_closed_lose_only_the_text(name, stream):
    sinks = {"stdout": ">&-", "both": "<&- >&- 2>&-"}[stream]
    assert shell([*script_of(name), "--help"], sinks) == (0, "", "")
    assert shell([*script_of(name), "--no-such-flag"], sinks)[0] == 2


def test_a_full_disk_under_the_output_is_one_line(name):
    said = f"{name.replace('_', '-')}: input or output: No space left on device\n"
    assert shell([*script_of(name), "--help"], "> /dev/full") == (1, "", said)


def test_a_full_disk_under_the_complaints_changes_no_exit_code(name):
    assert shell([*script_of(name), "--no-such-flag"], "2> /dev/full") == (2, "", "")


@pytest.fixture(scope="module")
def at_work(tmp_path_factory):
    """A folder, and command lines by command, which find there what they are asked about."""
    folder = tmp_path_factory.mktemp("work")
    (log,) = record(folder)
    (folder / "team.key").write_bytes(bytes(range(32)))
    (folder / "team.key").chmod(0o600)
    places = [f"127.0.0.1:{free_port()[1]}" for _ in range(2)]
    (folder / "team.toml").write_text(
        f'[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\naddress = "{places[0]}"\n'
        f'[carrier]\nkey = "team.key"\n[watch]\naddress = "{places[1]}"\n'
    )
    return folder, {
        "edge_run": "--robot-id 0 --duration 0.1 --no-log",
        "edge_doctor": "--robot-id 0",
        "edge_replay": log.name,
        "edge_report": f"{log.name} -o page.html",
        "edge_ctl": "status --fleet team.toml --timeout 0.1",
        "edge_watch": "--fleet team.toml --once",
    }


@pytest.mark.parametrize("sinks", [">&-", "> /dev/full", "| true; exit ${PIPESTATUS[0]}"])
@pytest.mark.parametrize(
    "name", ["edge_run", "edge_doctor", "edge_replay", "edge_report", "edge_ctl", "edge_watch"]
)
def test_a_command_at_work_does_not_mind_what_becomes_of_its_text(at_work, name, sinks):
    """But for its exit code, where the text is all that it was asked for."""
    folder, words = at_work
    command = [*script_of(name), *words[name].split()]
    plain = subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode
    code, shown, said = shell(command, sinks, cwd=folder)
    assert shown == "" and "Traceback" not in said
    if name == "edge_run" or sinks == ">&-":
        assert code == plain
    else:
        assert code in (plain, 1)
    assert said.count("\n") == (sinks == "> /dev/full" and name != "edge_run")


INTERRUPT = """
import os, signal, sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[-1]:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
"""


def test_an_interruption_while_a_command_is_loaded_is_one_line(name):
    module = SCRIPTS[name.replace("_", "-")]
    done = subprocess.run([*script_of(name, INTERRUPT), module], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, f"{name.replace('_', '-')}: interrupted\n")


NOBODY = """
import os, pwd
os.environ.pop("HOME", None)
def unknown(*_):
    raise KeyError("getpwuid(): uid not found")
pwd.getpwuid = pwd.getpwnam = unknown
"""


def test_a_user_without_a_home_directory_has_every_command(name):
    command = [*script_of(name, NOBODY), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert not done.stderr or done.stderr.startswith("Matplotlib ")  # on where it keeps its own files


def test_a_run_of_a_user_without_a_home_directory_says_where_logs_go():
    command = [*script_of("edge_run", NOBODY), "--robot-id", "0", "--duration", "0.2"]
    environment = {name: value for name, value in os.environ.items() if name != "XDG_STATE_HOME"}
    run_it = partial(subprocess.run, env=environment, capture_output=True, text=True, check=False)
    done = run_it(command)
    said = "edge-run: this user has no home directory; say with --log-dir where logs go, or --no-log\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)
    assert run_it([*command, "--no-log"]).returncode == 0


@pytest.mark.parametrize("given", ["XDG_STATE_HOME", "cwd"])
def test_a_folder_that_is_not_utf_8_is_one_line(given, tmp_path):
    folder = tmp_path / os.fsdecode(b"no\xffutf8")
    folder.mkdir()
    (folder / "team.toml").write_text("[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n")
    environment, flags = {**os.environ}, ["--robot-id", "0", "--duration", "0.1"]
    if given == "XDG_STATE_HOME":
        environment["XDG_STATE_HOME"] = str(folder)
    else:
        flags += ["--fleet", "team.toml", "--log-dir", str(tmp_path)]
    done = subprocess.run(
        [*script_of("edge_run"), *flags], env=environment, cwd=folder, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr.count(b"\n")) == (2, 1)
    assert b"no\\xffutf8" in done.stderr and b"is not UTF-8; rename the folder" in done.stderr


def test_a_path_that_is_not_utf_8_is_one_line(name):
    done = subprocess.run([*script_of(name), b"--fleet=\xff\x1b[2J.toml"], capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (2, b"")
    said = b"%s: b'--fleet=\\xff\\x1b[2J.toml' is not UTF-8; rename the file\n"
    assert done.stderr == said % name.replace("_", "-").encode()


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


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_command_tells_its_version(name):
    done = run(SCRIPTS[name], "--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{name} {edge_runtime.__version__}\n", "")
