"""Samplers on the tables' episodes: what is asked, what the page says, and that it is the rows'."""

import pytest
from msgspec.structs import replace

from benchmarks.paper import evaluation, paper_command
from benchmarks.paper.samplers import samplers_command as samplers
from benchmarks.paper.samplers.samplers_page import samplers_table
from benchmarks.paper.tuning import tuned_default


@pytest.fixture
def in_process(monkeypatch):
    """Answer here, and count."""
    asked, answer = [], evaluation.answer

    def one_by_one(questions, policies, _jobs, known):
        have = {row.key for row in known}
        for question in questions:
            if evaluation.key(question, policies) not in have:
                asked.append(question)
                yield answer(question, policies)

    monkeypatch.setattr(evaluation, "answer_all", one_by_one)
    return asked


def test_the_command_asks_nothing_twice(in_process, tmp_path):
    flags = ["--tasks", "navigation", "--episodes", "2", "--seeds", "0", "1"]
    for _ in range(2):
        files = ["--json", str(tmp_path / "rows.json"), "--reference", str(tmp_path / "paper.json")]
        assert samplers.main([*flags, *files]) == 0
    ways = [(each.exponential_steps, each.seed) for each in in_process]
    assert ways == [(steps, seed) for steps in (None, 3) for seed in (0, 1)]
    assert {each.settings for each in in_process} == {tuned_default("navigation")}
    assert "| exponential | 3 |" in (tmp_path / "paper" / "samplers.md").read_text()


def test_differences_are_of_the_same_policies():
    rows = evaluation.read_result(paper_command.RESULTS, list[evaluation.Row])
    first, *_ = (row for row in rows if row.task == "navigation" and row.method == "CFPG")
    both = [replace(first, seed=seed, multi_objective_success=90.0 + 10.0 * seed) for seed in (0, 1)]
    few = [
        replace(row, exponential_steps=3, multi_objective_success=value)
        for row, value in zip(both, (90.5, 99.9), strict=True)
    ]
    lines = samplers_table([*both, *few]).splitlines()
    assert lines[2] == "| euler | 10 | 95.0 ± 7.1 |  |  |"
    assert lines[3].startswith("| exponential | 3 | 95.2 ± 6.6 | +0.20 ± 0.30 | p = ")


def test_the_recorded_page_is_that_of_the_recorded_rows(monkeypatch, tmp_path):
    monkeypatch.setattr(evaluation, "answer", lambda *_: pytest.fail("a row is missing"))
    (tmp_path / "rows.json").write_bytes(samplers.RESULTS.read_bytes())
    assert samplers.main(["--json", str(tmp_path / "rows.json")]) == 0
    page = samplers.RESULTS.parent / "paper" / "samplers.md"
    assert (tmp_path / "paper" / "samplers.md").read_text() == page.read_text()
