from export.training.metrics import MetricsRow
from export.training.progress import ProgressView


def test_lines_without_a_terminal_name_every_figure(capsys):
    row = MetricsRow(500, 1.0, 0.01, 0.2, 1e-3, 0.87, 0.5, 0.125)
    with ProgressView(0, 1000, "collision") as view:
        view.show(row)
        view.show(MetricsRow(1000, 2.0, 0.01, 0.2, 1e-3, None, None, None, 0.9, 0.97, 0.01, 0.97))
    first, last = capsys.readouterr().out.splitlines()
    for figure in ("50%", "500 frames", "return 0.87", "success 50.0%", "collisions 12.5%", "left"):
        assert figure in first
    assert "validated 97.0%" in last
    assert "0:00 left" in last
