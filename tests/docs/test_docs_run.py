"""The commands of README and docs run: in a folder of their own, in the order in which a page gives them.

What a page takes for given is put there: the files that it shows, a key, a log of a team, a training. Runs
are cut short. What needs a bus, a screen or minutes is only parsed, by `test_docs`; `PARSED_ONLY` says why.
"""

import importlib.util
import os
import re
import secrets
import shlex
import shutil
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from bundle_files import write_bundle
from doc_pages import PAGES, ROOT, blocks, commands, program
from logs import record
from ports import free_port
from waiting import HANG_S, until

WORKSTATION = all(map(importlib.util.find_spec, ("torch", "onnx")))
WHEELS = importlib.util.find_spec("mujoco")
POLICIES = ROOT / "edge_runtime" / "bundles"
DURATION_S = "0.4"

PARSED_ONLY = {
    r"export\.edge_train ": "trains for minutes; tests/export/training/test_run.py trains less",
    r"export\.train_all ": "trains for hours; tests/export/test_train_all.py goes through the motions",
    r"sil\.edge_sil ": "starts a team for half a minute; its tests drive shorter ones",
    r"run .*--bus (?!sim )|--bridge mavlink": "needs firmware on a bus; edge-sil's tests have both",
    r"--bridge ros": "needs a robot's ROS; tests/firmware_bridge/ros/test_page.py runs the page beside one",
    r"pose\.edge_pose ": "sends what robots or a motion-capture host wait for; its tests play both",
    r"watch\.edge_watch (?!.*--once)": "goes on until somebody ends it; its tests do",
    r"benchmarks\.\w+\.(recording|latency)_command ": "measures for minutes; their tests measure less",
}
"""Which command lines are not run, by a pattern of module and arguments, and why."""
EXPECTED = {
    r"ctl policy ": (2, "trusted_keys"),  # nobody signed it
    r"ctl |watch\.edge_watch .*--once": (1, "robot"),  # no robot answers, and each is named
    r"doctor --whole-fleet ": (0, "answer of 0"),  # nobody runs, which is a warning
    r"doctor .*--bus sim": (0, "--arm enables it"),
    r"doctor ": (1, "the only robot of its fleet"),  # no bus is there, and the rest is checked
}
"""Exit code and a word of the output of those that do not end with 0, or where the word matters."""
SHORTER = {
    r"run\.edge_run .*--bus sim": ["--duration", DURATION_S, "--guard-deadline", "1"],
    r"run\.edge_run ": ["--duration", DURATION_S],
}


def first(patterns, line):
    """What stands beside the pattern that a command line matches."""
    return next((value for pattern, value in patterns.items() if re.search(pattern, line)), None)


def lines_of(page):
    """The command lines of a page that are ours: module, arguments, where the output goes."""
    for words, output in commands(page):
        if found := program(words):
            yield found[0], found[1], output


def described(module, arguments):
    return f"{module} {shlex.join(arguments)} "


RUN = {
    page.name: [
        line for line in lines_of(page) if first(PARSED_ONLY, described(line[0], line[1])) is None
    ]
    for page in PAGES
}  # fmt: skip


def free_address(_match):
    return '"{}:{}"'.format(*free_port())


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    (path,) = record(tmp_path_factory.mktemp("given"), "--duration", DURATION_S)
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where a reader stands: logs go here unless the command says otherwise, and our benchmarks lie here."""
    folder = tmp_path / "cfpg-edge" / "logs"
    folder.mkdir(parents=True)
    (folder / "benchmarks").symlink_to(ROOT / "benchmarks")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return folder


def give(page, folder, log):
    """Put down what a page takes for given."""
    team = (ROOT / "edge_runtime" / "fleets" / "udp.toml").read_text() + '\n[watch]\naddress = "10.0.0.5:1"\n'
    if page.name == "team.md":
        team = blocks(page, "toml")[0]
    (folder / "team.toml").write_text(re.sub(r'"[\d.]+:\d+"', free_address, team))
    (folder / "one.toml").write_text(blocks(ROOT / "docs" / "first-robot-can.md", "toml")[0])
    (folder / "slow.toml").write_text(blocks(ROOT / "README.md", "toml")[0])
    (folder / "stay_north.py").write_text(blocks(ROOT / "README.md", "python")[0])
    for name in ("team.key", "release.key"):
        key = os.open(folder / name, os.O_WRONLY | os.O_CREAT, 0o600)
        os.write(key, secrets.token_hex(32).encode())
        os.close(key)
    shutil.copy(log, folder / "run.mcap")
    (folder / "policies").mkdir()
    write_bundle(folder / "policies" / "new")
    if WORKSTATION:
        give_training(folder)
    else:
        shutil.copytree(POLICIES / "navigation", folder / "policies" / "navigation")


def give_training(folder):
    """A run of edge-train that is over, another project's graph of a velocity, and what that one saw."""
    import onnx.utils  # noqa: PLC0415
    import torch  # noqa: PLC0415

    from export.algorithms.networks import FlowNetwork  # noqa: PLC0415
    from export.training.checkpoint import PolicyFacts, save_policy  # noqa: PLC0415

    torch.manual_seed(0)
    (folder / "runs" / "nav").mkdir(parents=True)
    facts = PolicyFacts("navigation", "mafpo", 0, 1000, "abc", 0.9, 8)
    save_policy(folder / "runs" / "nav", FlowNetwork(18, 2, (16, 16)), facts)
    onnx.utils.extract_model(
        str(POLICIES / "navigation" / "policy.onnx"),
        str(folder / "velocity.onnx"),
        ["action", "tau", "observation"],
        ["velocity"],
    )
    np.savez(folder / "seen.npz", observation=np.random.default_rng(0).normal(size=(20, 18)))


def expanded(word, folder, log):
    """What the shell makes of a word; a pattern of logs that other robots wrote finds one."""
    if "*" not in word:
        return [word]
    if not list(folder.glob(word)):
        given = folder / word.replace("*", "")
        given.parent.mkdir(exist_ok=True)
        shutil.copy(log, given)
    return sorted(str(path.relative_to(folder)) for path in folder.glob(word))


def run_through(words, folder):
    """A command that has run; not one whose guard stopped the robot because the machine was busy."""
    done = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=folder, capture_output=True, text=True, check=False, timeout=HANG_S,
    )  # fmt: skip
    return None if "no fresh command" in done.stderr else done


@pytest.mark.parametrize("page", [page for page in PAGES if RUN[page.name]], ids=lambda page: page.name)
def test_a_pages_commands_run_in_its_order(page, folder, log):
    give(page, folder, log)
    for module, arguments, output in RUN[page.name]:
        line = described(module, arguments)
        if not WORKSTATION and re.search(r"^(export|benchmarks)\b|--task (balance|sampling) ", line):
            continue
        if not WHEELS and "--task husky " in line:
            continue
        words = [path for word in arguments for path in expanded(word, folder, log)]
        code, told = first(EXPECTED, line) or (0, "")
        done = until(partial(run_through, [module, *words, *(first(SHORTER, line) or ())], folder))
        assert (done.returncode, "Traceback" in done.stderr) == (code, False), f"{line}\n{done.stderr}"
        assert told in done.stdout + done.stderr, line
        if output:
            (folder / output).write_text(done.stdout)


def test_every_reason_not_to_run_a_command_is_needed():
    lines = [described(module, arguments) for page in PAGES for module, arguments, _ in lines_of(page)]
    assert all(any(re.search(pattern, line) for line in lines) for pattern in PARSED_ONLY)
    assert len(RUN["README.md"]) > 10
