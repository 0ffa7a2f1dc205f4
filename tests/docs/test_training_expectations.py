"""What help and docs lead one to expect of training is what the published curves and tables say."""

import csv
import re
from statistics import mean

import pytest
from paths import ROOT

from export.edge_train import EPILOG

RESULTS = ROOT / "benchmarks" / "results"
POLICY = (ROOT / "docs" / "policy.md").read_text()
SAMPLES = 150.0
"""Of an episode with a score of 1, see `export.scenarios.sampling`."""


def shown(task, score):
    return f"{SAMPLES * score:.0f}" if task == "sampling" else f"{100 * score:.0f} %"


def expected():
    """What the curves say of each task: (frames, what is shown of them)."""
    with (RESULTS / "paper" / "curves.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["algorithm"] == "mafpo-chain"]
    scores = {}
    for row in rows:
        scores.setdefault((row["task"], int(row["frames"])), []).append(float(row["score"]))
    return {
        task: {frames: shown(task, mean(each)) for (of, frames), each in scores.items() if of == task}
        for task in ("navigation", "balance", "sampling")
    }


def number(text):
    return int(text.replace(",", ""))


@pytest.mark.parametrize(("task", "pairs"), expected().items())
def test_the_help_tells_what_the_curves_show(task, pairs):
    (line,) = re.findall(rf"^  {task} +(.*after.*)$", EPILOG, re.MULTILINE)
    told = re.findall(r"(\d+(?: %)?)(?: [a-z][^,]*?)? after ([\d,]+\d)", line)
    assert len(told) == 3
    for figure, frames in told:
        assert figure == pairs[number(frames)]
    assert number(told[-1][1]) == max(pairs)


@pytest.mark.parametrize(("task", "pairs"), expected().items())
def test_the_table_tells_what_curves_and_results_show(task, pairs):
    (table,) = re.findall(rf"^(\| `{task}` .*?)(?=^\| `|^\n)", POLICY, re.DOTALL | re.MULTILINE)
    told = re.findall(r"\| ([\d,]+) \| (?:a score of )?(\d+(?: %)?)", table)
    assert len(told) == 3
    for frames, figure in told:
        assert figure == pairs[number(frames)]
    tables = (RESULTS / "paper" / "paper.md").read_text()
    row = re.search(r"^\| CFPG \| (.*) \|$", tables, re.MULTILINE)[1]
    guided = dict(zip(expected(), re.findall(r"[\d.]+ ± [\d.]+", row), strict=True))
    assert f"{guided[task]} %" in table
