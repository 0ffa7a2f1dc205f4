"""``python -m benchmarks ablation``: what each part of the tuned default is good for.

Rows come and resume as those of the tables do.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.flags import add_rows, make_parser
from benchmarks.paper.ablation.ablation_page import write_ablation
from benchmarks.paper.ablation.variants import Variant, variants
from benchmarks.paper.evaluation import EVALUATION_SEED, evaluate
from benchmarks.paper.policies import SEEDS
from benchmarks.paper.rows import Question
from benchmarks.paper.settings import Descent, Shield
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import chosen, read_tuned, tuned_default
from edge_runtime.errors import ConfigError

RESULTS = Path(__file__).parents[2] / "results" / "paper_ablation.json"


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    options = _parse(arguments)
    asked = {
        (task, variant.name, seed): question(task, variant, seed, options.episodes)
        for task in options.tasks
        for variant in tuned_variants(task)
        for seed in options.seeds
    }
    answers = evaluate(list(asked.values()), options.json, options.policies, options.jobs)
    rows = dict(zip(asked, answers, strict=True))
    tables = {
        task: [
            (each, [rows[task, each.name, seed] for seed in options.seeds]) for each in tuned_variants(task)
        ]
        for task in options.tasks
    }
    print(write_ablation(tables, options.json.parent / "paper" / "ablation.md"))
    return 0


def tuned_variants(task: str) -> list[Variant]:
    """All variants of what tuning chose.

    Raises:
        ConfigError: if a method was not tuned.
    """
    descent, shield = (chosen(read_tuned(), task, method) for method in ("MAPPO+PGD", "MAPPO+SHLD"))
    if not (isinstance(descent, Descent) and isinstance(shield, Shield)):
        raise ConfigError(f"a baseline was tuned on {task} with other settings than its own")
    return list(variants(TASKS[task], tuned_default(task), descent, shield))


def question(task: str, variant: Variant, seed: int, episodes: int) -> Question:
    """Ask for a variant's row."""
    return Question(
        task=task,
        method=variant.method,
        settings=variant.settings,
        seed=seed,
        episodes=episodes,
        episodes_seed=EVALUATION_SEED,
        **variant.circumstances,
    )


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = make_parser("ablation", __doc__)
    parser.add_argument("--seeds", type=int, nargs="*", default=range(SEEDS), help="of the policies (all)")
    add_rows(parser, tuple(TASKS), 50, RESULTS)
    return parser.parse_args(arguments)
