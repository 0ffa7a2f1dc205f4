"""``python -m benchmarks paper``: Tables II and III and Figs. 3, 6 and 7, by the deployed runtime."""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from rich.progress import Progress

from benchmarks.common.flags import add_rows, make_parser
from benchmarks.paper.candidates import ALONE, METHODS, PROJECTIONS, scaled
from benchmarks.paper.evaluation import EVALUATION_SEED, evaluate
from benchmarks.paper.paper_page import write_page
from benchmarks.paper.policies import SEEDS
from benchmarks.paper.rows import Question
from benchmarks.paper.settings import Settings
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import chosen, read_tuned, tune, write_tuned

RESULTS = Path(__file__).parents[1] / "results" / "paper.json"
SWEEP_STEPS = (1, 2, 3, 5, 10, 20)
SWEEP_EPISODES = 200
EXAMPLES = """\
examples:
  python -m benchmarks paper                        everything; interrupt it and start it again as you like
  python -m benchmarks paper --quick                a few episodes of the first seed; leaves nothing behind
  python -m benchmarks paper --tune                 choose every method's settings anew
  python -m benchmarks paper --policies runs        policies as python -m export.train_all leaves them
"""


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    options = _parse(arguments)
    if options.tune:
        _tune(options)
        return 0
    seeds, episodes, sweep = (1, 20, 10) if options.quick else (SEEDS, options.episodes, SWEEP_EPISODES)
    asked = questions(options.tasks, seeds, episodes, sweep)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / RESULTS.name if options.quick else options.json
        rows = evaluate(asked, path, options.policies, options.jobs)
        print(write_page(rows, options.policies, path.parent / "paper", quick=options.quick))
    return 0


def questions(tasks: Sequence[str], seeds: int, episodes: int, sweep_episodes: int) -> list[Question]:
    """All rows of the tables, then those of Figs. 6 and 7.

    Raises:
        ConfigError: if a method was not tuned.
    """
    tuned, asked = read_tuned(), []
    best = {task: {method: chosen(tuned, task, method) for method in METHODS} for task in tasks}
    for seed in range(seeds):
        for task in tasks:
            for method, settings in (best[task] | ALONE).items():
                asked.append(_question(task, method, settings, episodes, seed))
    for task in tasks:
        for method in ("CFPG", *PROJECTIONS):
            for settings in scaled(best[task][method]):
                asked.append(_question(task, method, settings, sweep_episodes))
        for steps in SWEEP_STEPS:
            asked.append(_question(task, "CFPG", best[task]["CFPG"], sweep_episodes, euler_steps=steps))
    return asked


def _question(
    task: str, method: str, settings: Settings, episodes: int, seed: int = 0, euler_steps: int | None = None
) -> Question:
    return Question(
        task=task,
        method=method,
        settings=settings,
        seed=seed,
        euler_steps=euler_steps,
        episodes=episodes,
        episodes_seed=EVALUATION_SEED,
    )


def _tune(options: argparse.Namespace) -> None:
    tried = read_tuned()
    pairs = [(task, method) for task in options.tasks for method in options.methods]
    with Progress(disable=not sys.stderr.isatty()) as progress, ProcessPoolExecutor(options.jobs) as pool:
        bar = progress.add_task("methods tuned", total=len(pairs))
        jobs = [pool.submit(tune, task, method, options.policies) for task, method in pairs]
        for job in as_completed(jobs):
            new = job.result()
            best = next(row for row in new if row.chosen)
            tried = [row for row in tried if (row.task, row.method) != (best.task, best.method)] + new
            write_tuned(tried)
            progress.advance(bar)
            success = f"{best.multi_objective_success:.1f} %"
            print(f"{best.task}: {best.method}: {best.settings}, {success}", flush=True)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = make_parser("paper", __doc__, EXAMPLES)
    parser.add_argument("--quick", action="store_true", help="a short form that leaves nothing behind")
    parser.add_argument("--tune", action="store_true", help="choose the methods' settings instead")
    parser.add_argument("--methods", nargs="*", choices=METHODS, default=METHODS, help="to tune (all)")
    add_rows(parser, tuple(TASKS), 1000, RESULTS)
    return parser.parse_args(arguments)
