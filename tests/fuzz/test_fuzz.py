"""Whatever a stranger writes is read, or refused in a line: no traceback, no hang, no flood of memory.

A few cases of each kind; ``--fuzz`` makes all of them, in minutes. The cases are the same every time.
"""

import importlib.util
import os
import subprocess
import sys

import pytest
from paths import ROOT

HANG_S = 3600
"""Longer than any batch takes on any machine."""
KINDS = {
    "bundles": (10_000, 200, 10), "toml_files": (2000, 200, 4), "logs": (1000, 8, 20), "graphs": (500, 6, 10),
    "command_lines": (100, 40, 1), "recordings": (1000, 40, 4), "checkpoints": (1000, 40, 4),
}  # fmt: skip
"""Cases in full, cases otherwise, batches in full."""
WORKSTATION = ("graphs", "command_lines", "checkpoints")


def pytest_generate_tests(metafunc):
    full, batches = metafunc.config.getoption("--fuzz"), []
    for kind, (most, few, parts) in KINDS.items():
        count = most // parts if full else few
        batches += [(kind, first, count) for first in range(0, most if full else few, count)]
    metafunc.parametrize(
        ("kind", "first", "count"), batches, ids=[f"{kind}-{first}" for kind, first, _ in batches]
    )


def test_cases(tmp_path, kind, first, count):
    if kind in WORKSTATION and importlib.util.find_spec("torch") is None:
        pytest.skip("a workstation's")
    command = [sys.executable, "-m", "hostile.batch", kind, str(first), str(count), str(tmp_path)]
    support = os.pathsep.join([str(ROOT / "tests" / "support"), str(ROOT)])
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=HANG_S, stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": support, "XDG_STATE_HOME": str(tmp_path)},
    )  # fmt: skip
    *_, last = done.stdout.splitlines() or ["nothing"]
    assert (done.returncode, last) == (0, "done"), f"{kind}, {last}: {done.stderr[-3000:]}"
