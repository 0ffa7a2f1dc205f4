"""What the README shows works as it stands."""

import re

import msgspec
import numpy as np
import pytest
from paths import ROOT

from edge_runtime.config.objectives import load_objective_set
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.objectives.gradient_check import GradientReport

README = (ROOT / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_objective_of_ones_own_passes_its_check(tmp_path, capsys):
    objective, check = blocks("python")
    names = {"__name__": "stay_north"}
    exec(compile(objective, "README", "exec"), names)  # noqa: S102
    exec(compile(check, "README", "exec"), names)  # noqa: S102
    assert GradientReport.__name__ in capsys.readouterr().out
    (tmp_path / "stay_north.py").write_text(objective)
    (tmp_path / "mine.toml").write_text('[[objectives]]\ntype = "stay_north:StayNorth"\nline_m = 0.1\n')
    (loaded,) = load_objective_set(tmp_path / "mine.toml").objectives
    assert (loaded.name, loaded.line_m) == ("stay_north", 0.1)


def test_the_objectives_file_loads(tmp_path):
    (text,) = blocks("toml")
    (tmp_path / "slow.toml").write_text(text)
    asked = load_objective_set(tmp_path / "slow.toml")
    assert [type(objective) for objective in asked.objectives] == [SpeedLimit, SafetyMargin]
    assert asked.guidance == type(asked.guidance)()


GUIDANCE = {
    "unguided": ("unguided flow", 0.0),
    "hierarchical, eta 100": ("CFPG (eqs. 14, 15)", 100.0),
    "none, eta 30": ("CFPG (No HGP)", 30.0),
    "terminal, eta 0.3": ("CFPG", 0.3),
}
"""Rows of the README's table: methods of the results, and what they were tuned to."""
COLUMNS = ("navigation_success", "speeding_violation", "margin_violation", "multi_objective_success")


def recorded(mode, eta, episodes):
    """Navigation's rows of guided flows with T as trained."""
    rows = msgspec.json.decode((ROOT / "benchmarks" / "results" / "paper.json").read_bytes())
    return [
        row
        for row in rows
        if row["task"] == "navigation" and row["episodes"] == episodes and "euler_steps" not in row
        for guidance in [row["settings"].get("guidance", {})]
        if mode in (guidance.get("mode"), row["method"]) and guidance.get("scale") == eta
    ]


@pytest.mark.parametrize("name", GUIDANCE)
def test_the_guidance_table_is_the_recorded_one(name):
    rows = recorded(*GUIDANCE[name], episodes=1000)
    figures = [[row[column] for row in rows] for column in COLUMNS]
    cells = [f"{np.mean(values):.1f} ± {np.std(values, ddof=1):.1f}" for values in figures]
    assert len(rows) == 10
    assert f"| {name} | {' | '.join(cells)} |" in README


def test_the_table_of_scales_is_the_recorded_one():
    head, _, *lines = re.search(r"\| eta \|.*?\n\n", README, re.DOTALL)[0].strip().splitlines()
    for line in lines:
        mode, *shown = (cell.strip() for cell in line.strip("|").split("|"))
        for eta, success in zip(head.strip("|").split("|")[1:], shown, strict=True):
            (row,) = recorded(mode, float(eta), episodes=200)
            assert success == f"{row['multi_objective_success']:.1f}", (mode, eta)
