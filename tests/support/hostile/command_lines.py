"""Command lines with one thing wrong in them."""

import contextlib
import importlib
import io
import os
from collections.abc import Sequence
from typing import NamedTuple

from bundle_files import write_bundle

from edge_runtime.common.commands import COMMANDS
from edge_runtime.config.fleet import DEFAULT_FLEET

MEMORY_MIB = 1000
"""PyTorch's, where the commands of a workstation are read."""


class Flags(NamedTuple):
    """Of one command."""

    needed: Sequence[str]
    read: Sequence[str] = ()
    """Those that name files to read; words in braces are arguments."""
    written: Sequence[str] = ()
    words: Sequence[str] = ()
    """Those that take numbers and words."""


FLAGS = {
    "edge-run": Flags(["--robot-id", "0"], ["--fleet", "--policy", "--objectives"], ["--json", "--animate"],
                      ["--rate", "--duration", "--seed", "--robot-id", "--bridge"]),
    "edge-replay": Flags(["{log}"], ["--policy", "--objectives", "--fleet"], [], ["--own"]),
    "edge-sil": Flags(["--robots", "2"], ["--fleet", "--faults", "--limits"], ["--json"],
                      ["--robots", "--rate", "--duration"]),
    "edge-doctor": Flags(["--robot-id", "0"], ["--fleet", "--policy", "--objectives"], [], ["--rate"]),
    "edge-watch": Flags([], ["--fleet", "--key-file"]),
    "edge-report": Flags(["-o", "{out}"], ["{log}"], ["-o"]),
    "edge-ctl": Flags(["status"], ["--fleet", "--key-file"], [], ["--timeout"]),
    "edge-pose": Flags(["--replay", "{log}"], ["--fleet", "--replay"], [], ["--natnet"]),
    "edge-train": Flags(["navigation", "--out", "{out}"], [], [],
                        ["--frames", "--workers", "--algorithm", "--seed"]),
    "edge-export": Flags(["--out", "{out}"], ["--facts", "--from-onnx", "{log}"]),
}  # fmt: skip
WORDS = [
    "",
    " ",
    "-1",
    "nan",
    "inf",
    "1e999",
    "0x10",
    "a" * 5000,
    "\x1b[2J",
    "none",
    "9" * 5000,
]


def prepare(folder):
    os.mkfifo(folder / "pipe")
    write_bundle(folder / "bundle", weights=b"none")
    (folder / "loop").symlink_to(folder / "loop")
    (folder / "junk").write_bytes(b"\x00\xff" * 100)
    paths = [folder / name for name in ("pipe", "bundle", "junk", "loop", "none", "a" * 300)]
    paths += ["/dev/zero", "/proc/self/mem", "/proc/kmsg", "/", "\x1b[2J", "a\nb", "/proc/self/environ", ""]
    places = [folder / name for name in ("pipe", "bundle", "loop", "none/x", "a" * 300)]
    return folder, list(map(str, paths)), list(map(str, places))


def attempt(draw, given):
    folder, paths, places = given
    name = draw.choice(list(COMMANDS))
    flags = FLAGS[name]
    wrong = draw.choice([
        *([flag, draw.choice(paths)] for flag in flags.read),
        *([flag, draw.choice(places)] for flag in flags.written),
        *([flag, draw.choice(WORDS)] for flag in flags.words),
        draw.choice([["--none"], ["--non-existent=1"], ["-Z"], ["extra", "words"], ["--fleet"]]),
    ])  # fmt: skip
    wrong = [word for word in wrong if not word.startswith("{")]
    fleet = ["--fleet", str(DEFAULT_FLEET)] if "--fleet" in flags.read and "--fleet" not in wrong else []
    named = {"{log}": str(folder / "junk"), "{out}": str(folder / "out")}
    arguments = [*(named.get(word, word) for word in flags.needed), *fleet, *wrong]
    said, complained = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
        code = importlib.import_module(COMMANDS[name]).main(arguments)
    told = complained.getvalue()
    if name == "edge-doctor" and code == 1:  # it read the flags, and found what is wrong
        assert said.getvalue().replace("\n", "").isprintable(), said.getvalue()
        return
    assert (code, said.getvalue()) == (2, ""), (name, arguments, code, said.getvalue()[:300], told[:300])
    assert told.startswith(f"{name}: "), told
    assert told.endswith("\n"), told
    assert told[:-1].isprintable(), told
