"""What programs of others build on: the names, that they are there, and that nothing is loaded for them."""

import re
import subprocess
import sys

import pytest
from doc_pages import ROOT, blocks

import edge_runtime

NAMES = [
    "Belief",
    "Bundle",
    "EdgeError",
    "GuidanceSettings",
    "Guide",
    "GuidedAction",
    "Objective",
    "ObjectiveSet",
    "Observer",
    "Reading",
    "RobotState",
    "Slope",
    "Source",
    "TeamState",
    "Teammate",
    "TrackedObject",
    "View",
    "__version__",
    "check_gradient",
    "guide_for",
    "guided_action",
    "load_bundle",
    "load_objective_set",
    "packaged_bundle",
]


def test_the_public_names_stay():
    assert sorted(edge_runtime.__all__) == sorted(NAMES)
    for name in NAMES:
        assert getattr(edge_runtime, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'load_bundel'; it offers Belief, "):
        _ = edge_runtime.load_bundel


def test_type_checkers_know_them_from_where_they_are_imported():
    text = (ROOT / "edge_runtime" / "__init__.py").read_text()
    typed = re.findall(r"^    from edge_runtime\.([\w.]+) import (.*)$", text, re.MULTILINE)
    homes = {name: home for home, names in typed for name in names.split(", ")}
    assert homes == edge_runtime._HOMES


def test_the_package_alone_loads_nothing():
    code = (
        "import sys, edge_runtime; print(*(name for name in sys.modules if name.startswith('edge_runtime.')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_reference_lists_every_name_and_the_pages_example_runs(capsys):
    reference = (ROOT / "docs" / "api.md").read_text()
    assert sorted(re.findall(r"^::: edge_runtime\.(\w+)$", reference, re.MULTILINE)) == sorted(
        {*NAMES, "errors", "objectives"} - {"EdgeError"}
    )
    page = ROOT / "docs" / "library.md"
    (example,) = blocks(page, "python")
    exec(compile(example, "library.md", "exec"), {"__name__": "example"})  # noqa: S102
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert all(re.fullmatch(r"\(-?[\d.]+, -?[\d.]+\) \([\d.e-]+, [\d.e-]+\) ", line) for line in lines)
