"""What a person reads of an evaluation: the tables as Markdown and the figures beside them."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.paper.figures import draw_scales, draw_steps
from benchmarks.paper.policies import FIRST_FRESH_SEED
from benchmarks.paper.rows import Row
from benchmarks.paper.tables import metrics_table, success_table, tests_table
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.trajectories import draw_trajectories
from benchmarks.paper.tuning import chosen, read_tuned


def write_page(rows: Sequence[Row], policies: Path, out: Path, *, quick: bool) -> str:
    """Write ``paper.md`` and its pictures to a directory; returns the tables."""
    out.mkdir(parents=True, exist_ok=True)
    tabled = [
        row for row in rows if row.euler_steps is None and row.episodes == max(r.episodes for r in rows)
    ]
    swept = [row for row in rows if row.episodes < max(r.episodes for r in rows)]
    tasks = [name for name in TASKS if any(row.task == name for row in rows)]
    tables = [
        "## Multi-objective success in percent (the paper's in brackets)",
        success_table(tabled),
        "## Significance over seeds",
        tests_table(tabled),
    ]
    if fresh := [row for row in tabled if row.seed >= FIRST_FRESH_SEED]:
        title = f"## The same over seeds {FIRST_FRESH_SEED} and up alone, trained when all settings stood"
        tables += [title, success_table(fresh), tests_table(fresh)]
    for task in tasks:
        tables += [f"## {task.capitalize()}", metrics_table(tabled, task)]
        who = chosen(read_tuned(), TASKS[task], "CFPG")
        draw_trajectories(TASKS[task], who, policies, out / f"trajectories_{task}.png", quick=quick)
    draw_scales(swept, out / "scale.png")
    draw_steps(swept, out / "steps.png")
    figures = [f"![{path.stem}]({path.name})" for path in sorted(out.glob("*.png"))]
    text = "\n\n".join(tables)
    (out / "paper.md").write_text("\n\n".join([_head(tabled), text, "## Figures", *figures]) + "\n")
    return text


def _head(tabled: Sequence[Row]) -> str:
    seeds, episodes = len({row.seed for row in tabled}), tabled[0].episodes
    commits = ", ".join(sorted({row.commit for row in tabled if row.commit}))
    return (
        "# The paper's evaluation\n\nWritten by `python -m benchmarks paper`: mean ± standard deviation over "
        f"policies of {seeds} seeds, {episodes} episodes each, at commit {commits or 'unknown'}."
    )
