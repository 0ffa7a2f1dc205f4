"""Learning curves: what is learned anew replaces its own points alone."""

import csv

from benchmarks.paper import curves


def metrics(runs, algorithm, score):
    table = runs / "balance" / algorithm / "seed-0" / "metrics.csv"
    table.parent.mkdir(parents=True)
    table.write_text(f"frames,score\n12800,\n25600,{score}\n")


def points(path):
    with path.open() as lines:
        return [(row["algorithm"], row["frames"], row["score"]) for row in csv.DictReader(lines)]


def test_a_run_made_anew_replaces_its_own_points_and_no_others(tmp_path, monkeypatch):
    monkeypatch.setattr(curves, "OUT", tmp_path / "out")
    metrics(tmp_path / "first", "mappo", 0.25)
    metrics(tmp_path / "first", "mafpo", 0.5)
    assert curves.main(["--runs", str(tmp_path / "first")]) == 0
    metrics(tmp_path / "second", "mappo", 0.75)
    assert curves.main(["--runs", str(tmp_path / "second")]) == 0
    kept = [("mafpo", "25600", "0.5"), ("mappo", "25600", "0.75")]
    assert points(tmp_path / "out" / "curves.csv") == kept
    assert (tmp_path / "out" / "curves.png").stat().st_size > 1000
