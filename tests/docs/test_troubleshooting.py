"""Every message that the troubleshooting page explains is one that the program has."""

import ast
import re

import pytest
from paths import ROOT

PACKAGES = ("edge_runtime", "firmware_bridge", "export")
FIRST = re.compile(r"^\| (`+ ?)(.*?) ?`+ \| ", re.MULTILINE)


def text(node):
    """A string of the code as the page writes it: what differs is an ellipsis."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
    return ""


@pytest.fixture(scope="module")
def texts():
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    found = {text(node) for path in files for node in ast.walk(ast.parse(path.read_text()))}
    return {re.sub("…+", "…", one) for one in found}


MESSAGES = [found[1] for found in FIRST.findall((ROOT / "docs" / "troubleshooting.md").read_text())]


@pytest.mark.parametrize("message", MESSAGES)
def test_the_program_has_the_message(message, texts):
    assert message in texts


def test_the_page_has_messages():
    assert len(MESSAGES) > 40
