"""Learning curves: what is learned anew replaces its own points alone."""

import csv

import pytest

from benchmarks.paper import curves


def metrics(runs, algorithm, *scores):
    """A run's table: scores, each with the guided success that it counts, if it does."""
    table = runs / "balance" / algorithm / "seed-0" / "metrics.csv"
    table.parent.mkdir(parents=True)
    lines = [f"{25600 * (n + 1)},{guided},{score}\n" for n, (score, guided) in enumerate(scores)]
    table.write_text("frames,guided_success,score\n12800,,\n" + "".join(lines))


def points(path):
    with path.open() as lines:
        return [(row["algorithm"], row["frames"], row["score"]) for row in csv.DictReader(lines)]


def test_a_run_made_anew_replaces_its_own_points_and_no_others(tmp_path, monkeypatch):
    monkeypatch.setattr(curves, "OUT", tmp_path / "out")
    metrics(tmp_path / "first", "mappo", (0.25, ""))
    metrics(tmp_path / "first", "mafpo", (0.5, ""))
    assert curves.main(["--runs", str(tmp_path / "first")]) == 0
    metrics(tmp_path / "second", "mappo", (0.75, ""))
    assert curves.main(["--runs", str(tmp_path / "second")]) == 0
    kept = [("mafpo", "25600", "0.5"), ("mappo", "25600", "0.75")]
    assert points(tmp_path / "out" / "curves.csv") == kept
    assert (tmp_path / "out" / "curves.png").stat().st_size > 1000


def test_what_a_policy_does_alone_is_drawn_whether_guided_episodes_count_or_not(tmp_path, monkeypatch):
    monkeypatch.setattr(curves, "OUT", tmp_path / "out")
    metrics(tmp_path / "runs", "mappo", (0.08, ""), (0.9 * 0.5 + 0.1 * 0.9, 0.5))
    assert curves.main(["--runs", str(tmp_path / "runs")]) == 0
    told = [float(score) for _, _, score in points(tmp_path / "out" / "curves.csv")]
    assert told == pytest.approx([0.8, 0.9])
