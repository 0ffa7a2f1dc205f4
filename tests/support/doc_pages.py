"""The pages of the documentation, and the commands that they show."""

import re
import shlex

from paths import ROOT

from benchmarks.__main__ import COMMANDS as BENCHMARKS
from edge_runtime.common.commands import COMMANDS

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


OURS = {"benchmarks", "edge_runtime", "export", "firmware_bridge"}


def blocks(page, language):
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)
    return [text for kind, text in fenced if kind == language]


def commands(page):
    """The command lines of a page's blocks: their words, and the file that takes the output, if any."""
    for block in blocks(page, ""):
        for line in block.replace("\\\n", " ").splitlines():
            command = re.sub(r"\s{2,}[#(].*$", "", line).strip().removeprefix("OMP_NUM_THREADS=1 ")
            if re.match(r"[\w./-]*(edge-|python)", command):
                command, _, output = command.partition(" | ")[0].partition(" > ")
                yield shlex.split(command, comments=True), output


def program(words):
    """The module behind one of our command lines, and its arguments; None for another project's."""
    name, *rest = words
    name = name.rpartition("/")[2]
    if name in COMMANDS:
        return COMMANDS[name], rest
    if rest[:1] != ["-m"] or rest[1].split(".")[0] not in OURS:
        return None
    return (BENCHMARKS[rest[2]], rest[3:]) if rest[1] == "benchmarks" else (rest[1], rest[2:])
