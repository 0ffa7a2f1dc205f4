"""``python -m benchmarks paper --ablation``: what each part of the tuned default is good for.

On policies of seeds that tuning never saw; rows come and resume as those of the tables do.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.progress import Progress

from benchmarks.paper.ablation import circumstances, variants
from benchmarks.paper.ablation.ablation_page import write_ablation
from benchmarks.paper.ablation.variants import Variant
from benchmarks.paper.contestants import Contestant
from benchmarks.paper.evaluation import Question, answer_all, key
from benchmarks.paper.policies import POLICIES
from benchmarks.paper.rows import Row, read_rows, write_rows
from benchmarks.paper.tasks import TASKS, Task
from benchmarks.paper.tuning import chosen, read_tuned

FLAG = "--ablation"
RESULTS = Path(__file__).parents[2] / "results" / "paper_ablation.json"
HELD_OUT = (1, 2)
"""Seeds of the policies; tuning uses seed 0."""


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    options = _parse(arguments)
    rows = _evaluate(options)
    tables = {task: _answered(task, options, rows) for task in TASKS if any(r.task == task for r in rows)}
    print(write_ablation(tables, options.json.parent / "paper" / "ablation.md"))
    return 0


def all_variants(task: Task, default: Contestant, descent: Contestant) -> list[Variant]:
    """Every variant that means something on a task, the reference first."""
    ref = variants.reference(task, default)
    return [
        *variants.itself(ref),
        *variants.projections(ref),
        *variants.deconfliction(ref, descent),
        *variants.priorities(ref),
        *variants.samplings(ref),
        *circumstances.look_aheads(ref),
        *circumstances.intentions(ref),
        *circumstances.network(ref),
        *circumstances.masses(ref),
    ]


def tuned_variants(task_name: str) -> list[Variant]:
    """All variants of what tuning chose.

    Raises:
        ConfigError: if a method was not tuned.
    """
    task, tuned = TASKS[task_name], read_tuned()
    return all_variants(task, chosen(tuned, task, "CFPG"), chosen(tuned, task, "MAPPO+PGD"))


def question(task: str, variant: Variant, seed: int, episodes: int) -> Question:
    """Ask for a variant's row."""
    circumstance = (variant.neighbours, variant.loss, variant.masses_kg)
    return Question(task, variant.who, seed, episodes, None, *circumstance)


def _evaluate(options: argparse.Namespace) -> list[Row]:
    rows = read_rows(options.json)
    asked = [
        question(task, variant, seed, options.episodes)
        for seed in options.seeds
        for task in options.tasks
        for variant in tuned_variants(task)
    ]
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("rows", total=len(asked))
        for row in answer_all(asked, options.policies, options.jobs, rows):
            rows.append(row)
            write_rows(options.json, rows)
            progress.advance(bar)
    return rows


def _answered(task: str, options: argparse.Namespace, rows: Sequence[Row]) -> list[tuple[Variant, list[Row]]]:
    """Every variant of a task with its rows: those that answer today's questions, whatever else is kept."""
    known = {row.key: row for row in rows}
    answered = []
    for variant in tuned_variants(task):
        asked = [question(task, variant, seed, options.episodes) for seed in options.seeds]
        keys = [key(one, options.policies) for one in asked]
        answered.append((variant, [known[one] for one in keys if one in known]))
    return answered


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks paper {FLAG}", description=__doc__)
    parser.add_argument(FLAG, action="store_true", help="what chose this form")
    parser.add_argument("--tasks", nargs="*", choices=list(TASKS), default=list(TASKS))
    parser.add_argument("--episodes", type=int, default=200, help="of each row (200)")
    parser.add_argument("--seeds", type=int, nargs="*", default=HELD_OUT, help="of the policies (1 2)")
    parser.add_argument("--policies", type=Path, default=POLICIES, metavar="DIR")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="the rows")
    return parser.parse_args(arguments)
