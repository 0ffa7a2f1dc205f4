"""What tools and newcomers are told of this repository is there."""

import re

import msgspec
import pytest
from paths import ROOT

TOOLS = msgspec.toml.decode((ROOT / "pyproject.toml").read_bytes())["tool"]
NAMED = {
    "coverage": TOOLS["coverage"]["run"]["include"],
    "mutmut": TOOLS["mutmut"]["only_mutate"] + TOOLS["mutmut"]["pytest_add_cli_args_test_selection"],
}


@pytest.mark.parametrize("tool", NAMED)
def test_every_file_that_a_tool_is_told_exists(tool):
    assert [name for name in NAMED[tool] if not (ROOT / name).is_file()] == []


def test_what_is_covered_and_what_is_mutated_are_the_same():
    assert set(TOOLS["coverage"]["run"]["include"]) == set(TOOLS["mutmut"]["only_mutate"])


def test_every_folder_that_a_newcomer_is_sent_to_exists():
    rows = re.findall(r"^\| .* \| `(.*)` \|$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert len(rows) >= 20
    assert [row for row in rows if not (ROOT / row).is_dir()] == []
