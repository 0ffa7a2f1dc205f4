"""What a person reads of an evaluation: the tables as Markdown and the figures beside them."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.result_file import read_result
from benchmarks.common.result_page import page
from benchmarks.paper.figures import draw_scales, draw_steps
from benchmarks.paper.policies import FIRST_FRESH_SEED
from benchmarks.paper.possible import ORACLE
from benchmarks.paper.possible import Row as OracleRow
from benchmarks.paper.rows import Row
from benchmarks.paper.tables import metrics_table, share_table, success_table, tests_table
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.trajectories import draw_trajectories
from benchmarks.paper.tuning import tuned_default


def write_page(rows: Sequence[Row], policies: Path, out: Path, *, quick: bool) -> str:
    """Write ``paper.md`` and its pictures to a directory; returns it."""
    out.mkdir(parents=True, exist_ok=True)
    most = max(row.episodes for row in rows)
    tabled = [row for row in rows if row.euler_steps is None and row.episodes == most]
    swept = [row for row in rows if row.episodes < most]
    parts = [
        "## Multi-objective success in percent (the paper's in brackets)",
        success_table(tabled),
        *_shares(tabled),
        "## Significance over seeds",
        tests_table(tabled),
    ]
    if fresh := [row for row in tabled if row.seed >= FIRST_FRESH_SEED]:
        title = f"## The same over seeds {FIRST_FRESH_SEED} and up alone, trained when all settings stood"
        parts += [title, success_table(fresh), tests_table(fresh)]
    for task in dict.fromkeys(row.task for row in rows):
        parts += [f"## {task.capitalize()}", metrics_table(tabled, task)]
        picture = out / f"trajectories_{task}.png"
        draw_trajectories(TASKS[task], tuned_default(task), policies, picture, quick=quick)
    draw_scales(swept, out / "scale.png")
    draw_steps(swept, out / "steps.png")
    figures = [f"![{path.stem}]({path.name})" for path in sorted(out.glob("*.png"))]
    text = page("The paper's evaluation", "paper", _circumstances(tabled), *parts, "## Figures", *figures)
    (out / "paper.md").write_text(text)
    return text


def _shares(tabled: Sequence[Row]) -> list[str]:
    """The chapter about what is possible, if `python -m benchmarks oracle` has found out."""
    shares = share_table(tabled, read_result(ORACLE, list[OracleRow], default=[]))
    note = "Of the episodes that some policy or plan satisfies, in percent: see [the oracle](oracle.md)."
    return ["## Success as a share of what is possible", note, shares] if shares else []


def _circumstances(tabled: Sequence[Row]) -> str:
    seeds, episodes = len({row.seed for row in tabled}), tabled[0].episodes
    commits = ", ".join(sorted({row.commit for row in tabled if row.commit}))
    return (
        f"Mean ± standard deviation over policies of {seeds} seeds, {episodes} episodes each, at commit "
        f"{commits or 'unknown'}."
    )
