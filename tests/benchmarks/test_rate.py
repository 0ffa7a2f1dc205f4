"""The benchmark of control rates: the page states what was measured, and says no more than that."""

import pytest
from paths import ROOT

from benchmarks import rate
from benchmarks.common.result_file import read_result


def test_a_short_run_writes_its_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(rate, "EPISODE_S", 2.0)
    monkeypatch.setattr(rate, "RATES_HZ", (5.0, 20.0))
    assert rate.main(["--episodes", "2", "--json", str(tmp_path / "rows.json")]) == 0
    rows = read_result(tmp_path / "rows.json", list[rate.Row])
    assert [(row.rate_hz, row.guided) for row in rows] == [(5, True), (20, True), (5, False), (20, False)]
    assert all(row.success_share == 0.0 and row.arrival_s is None for row in rows)


@pytest.fixture
def rows():
    return {(row.rate_hz, row.guided): row for row in read_result(rate.RESULTS, list[rate.Row])}


def test_the_page_states_what_was_measured(rows):
    assert rate.rate_table([*rows.values()]) in (ROOT / "docs" / "rate.md").read_text()


def test_what_the_page_concludes_is_what_the_rows_say(rows):
    trained = rows[10.0, True]
    for rate_hz in (20.0, 50.0, 100.0):
        row = rows[rate_hz, True]
        assert 0.0 <= trained.success_share - row.success_share <= 0.035
        assert row.speeding_share < 0.01 and row.margin_share < 0.01
        ratio = row.action_change_per_s / trained.action_change_per_s
        assert ratio == pytest.approx(rate_hz / 10.0, rel=0.1)
    assert rows[5.0, True].speeding_share > 0.3
