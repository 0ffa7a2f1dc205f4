"""What the documentation shows works as it stands: its commands, its files, its links, its service."""

import argparse
import importlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import PAGES, ROOT, blocks, commands, program

from edge_runtime.common.commands import COMMANDS
from edge_runtime.config.fleet import FLEETS, load_fleet
from edge_runtime.config.objectives import load_objective_set
from edge_runtime.errors import ConfigError
from edge_runtime.objectives import BUILT_IN
from edge_runtime.objectives.gradient_check import check_gradient
from firmware_bridge.can.profile import PROFILES as CAN_PROFILES
from firmware_bridge.mavlink.profiles import PROFILES as MAVLINK_PROFILES
from firmware_bridge.ros.profile import PROFILES as ROS_PROFILES

PYPROJECT = ROOT / "pyproject.toml"


class UnderstoodError(BaseException):
    """A command line was understood; its program need not go on."""


OWN = {
    f"{page.name}: {' '.join(words)}": found
    for page in PAGES
    for words, _ in commands(page)
    if (found := program(words))
}


def test_every_extra_is_named_where_it_is_needed():
    """By the command that installs it; those of developers are named in CONTRIBUTING.md."""
    table = PYPROJECT.read_text().partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    offered = set(re.findall(r"^(\w+) = \[", table, re.MULTILINE)) - {"dev", "docs", "mutation", "test"}
    named = re.findall(
        r"pip install (?:-e )?'(?:cfpg-edge|\.)\[([\w,]+)\]'", "".join(map(Path.read_text, PAGES))
    )
    assert offered <= {extra for extras in named for extra in extras.split(",")}


@pytest.mark.parametrize("line", OWN)
def test_every_command_is_understood_by_its_program(line, monkeypatch):
    module, arguments = OWN[line]
    if module.startswith(("export", "benchmarks")):
        pytest.importorskip("torch", reason="a robot's environment has no workstation's programs")
        pytest.importorskip("onnx", reason="a robot's environment has no workstation's programs")
    parse = argparse.ArgumentParser.parse_args

    def parse_and_leave(parser, given=None, namespace=None):
        parse(parser, given, namespace)
        raise UnderstoodError

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_and_leave)
    monkeypatch.setattr(sys, "argv", ["", *arguments])
    main = importlib.import_module(module).main
    with pytest.raises(UnderstoodError):
        main(arguments) if main.__code__.co_argcount else main()


def anchors(page):
    """Those of a page's headings, as they are made on the web."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("name", ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"])
def test_every_link_beside_the_pages_leads_somewhere(name):
    """Those of the pages themselves are checked as the site is built."""
    for link in re.findall(r"\]\(([^)\s]+)\)", (ROOT / name).read_text()):
        file, _, anchor = link.partition("#")
        if not link.startswith("https://"):
            assert (ROOT / file).exists(), link
            assert not anchor or anchor in anchors(ROOT / (file or name)), link


def test_every_extra_that_a_user_may_want_is_listed():
    (extras,) = re.findall(
        r"^\[project.optional-dependencies]\n(.*?)^\[", PYPROJECT.read_text(), re.DOTALL | re.MULTILINE
    )
    page = (ROOT / "docs" / "install.md").read_text()
    names = {*re.findall(r"^(\w+) = ", extras, re.MULTILINE)} - {"test", "mutation", "dev"}
    assert {name for name in names if f"`{name}`" not in page} == set()


def test_the_pages_show_commands_of_every_program():
    assert set(COMMANDS.values()) <= {module for module, _ in OWN.values()}


@pytest.mark.parametrize(("page", "robots"), [("team.md", [0, 1]), ("first-robot-can.md", [0])])
def test_the_fleet_file_loads(page, robots, tmp_path):
    text = blocks(ROOT / "docs" / page, "toml")[0]
    (tmp_path / "team.toml").write_text(text)
    fleet = load_fleet(tmp_path / "team.toml")
    assert [robot.id for robot in fleet.robots] == robots


OBJECTIVES = [("speed_limit", "safety_margin"), ("safety_margin",), ("spatial_order", "passing")]
"""Of the page's first files; the last two are of fleet files."""


def test_the_objectives_files_load_and_the_own_objective_passes_its_check(tmp_path, capsys):
    page = ROOT / "docs" / "objective.md"
    *files, fleet, believing = blocks(page, "toml")
    (tmp_path / "team.toml").write_text(fleet)
    assert len(load_fleet(tmp_path / "team.toml").obstacles) == 2
    assert believing in (FLEETS / "sampling.toml").read_text()
    for text, names in zip(files, OBJECTIVES, strict=True):
        (tmp_path / "mine.toml").write_text(text)
        assert tuple(o.name for o in load_objective_set(tmp_path / "mine.toml").objectives) == names
    names = {"__name__": "stay_north", "check_gradient": check_gradient}
    for code in blocks(page, "python"):
        exec(compile(code, "objective.md", "exec"), names)  # noqa: S102
    assert "worst_error" in capsys.readouterr().out


def test_every_profile_has_a_row_and_none_was_tried_on_hardware():
    page = (ROOT / "docs" / "robots.md").read_text()
    rows = re.findall(r"^\| (`[^|]*`) \| .* \| (.*) \|$", page, re.MULTILINE)
    listed = {name for names, _ in rows for name in re.findall(r"`(\w+)`", names)}
    files = (*CAN_PROFILES.glob("*.toml"), *ROS_PROFILES.glob("*.toml"))
    assert listed == {*(file.stem for file in files), *MAVLINK_PROFILES}
    assert {tried for _, tried in rows} == {"everything"}


def test_the_page_lists_every_built_in_objective_with_its_keys_and_which_are_preferences():
    table = (ROOT / "docs" / "objective.md").read_text()
    for kind in BUILT_IN:
        (row,) = re.findall(rf"^\| `{kind.__struct_config__.tag}` \| (.*) \| (.*) \|$", table, re.MULTILINE)
        assert set(re.findall(r"`(\w+)`", row[1])) == set(kind.__struct_fields__) - {"weight", "look_ahead"}
        assert row[0].endswith("(a preference)") == kind.preference


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_service_is_one_that_systemd_takes(tmp_path):
    unit = ROOT / "edge_runtime" / "systemd" / "edge-run@.service"
    edge_run = Path(sys.executable).with_name("edge-run")
    text = unit.read_text().replace("/opt/cfpg-edge/bin/edge-run", str(edge_run))
    copy = tmp_path / unit.name
    copy.write_text(text)
    line = ["systemd-analyze", "verify", str(copy)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr.strip(), done.stderr


def test_the_service_neither_arms_nor_restarts_by_itself():
    text = (ROOT / "edge_runtime" / "systemd" / "edge-run@.service").read_text()
    assert "--arm" not in text
    assert "Restart=no" in text


def test_the_table_of_faults_is_what_its_command_writes(tmp_path):
    pytest.importorskip("rich", reason="a robot's environment has no benchmarks")
    failsafe = importlib.import_module("benchmarks.faults.failsafe")
    page = tmp_path / "limits.md"
    page.write_text(f"above\n{failsafe.BEGIN}an older table\n{failsafe.END}\nbelow\n")
    assert failsafe.main(["--page", str(page)]) == 0
    written = page.read_text()
    assert written.startswith("above\n") and written.endswith("\nbelow\n") and "older" not in written
    _, begin, rest = failsafe.PAGE.read_text().partition(failsafe.BEGIN)
    table, end, _ = rest.partition(failsafe.END)
    assert f"above\n{begin}{table}{end}\nbelow\n" == written
    page.write_text("no table\n")
    with pytest.raises(ConfigError, match="has no lines"):
        failsafe.main(["--page", str(page)])
