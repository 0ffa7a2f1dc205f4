"""``python -m benchmarks samplers``: few steps of the exponential sampler against ten of Euler's.

The tables' episodes and policies again, the guidance as tuned, every row beside `paper`'s of the same policy.
Interrupt it and start it again as you like.
"""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.flags import add_rows, make_parser
from benchmarks.paper import paper_command
from benchmarks.paper.evaluation import EVALUATION_SEED, evaluate
from benchmarks.paper.policies import SEEDS
from benchmarks.paper.rows import Question
from benchmarks.paper.samplers.samplers_page import write_samplers
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default

RESULTS = Path(__file__).parents[2] / "results" / "paper_samplers.json"
STEPS = {"navigation": 3, "balance": 3, "sampling": 4}
"""Of the exponential sampler: as few as the packaged policies take."""


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("samplers", __doc__)
    parser.add_argument("--seeds", type=int, nargs="*", default=range(SEEDS), help="of the policies (all)")
    parser.add_argument(
        "--reference", type=Path, default=paper_command.RESULTS, metavar="FILE", help="rows of `paper`"
    )
    add_rows(parser, tuple(TASKS), 1000, RESULTS)
    options = parser.parse_args(arguments)
    tables = {}
    for task in options.tasks:
        own, few = (
            [question(task, seed, options.episodes, steps) for seed in options.seeds]
            for steps in (None, STEPS[task])
        )
        reference = evaluate(own, options.reference, options.policies, options.jobs)
        rows = evaluate(few, options.json, options.policies, options.jobs)
        tables[task] = [*reference, *rows]
    print(write_samplers(tables, options.json.parent / "paper" / "samplers.md"))
    return 0


def question(task: str, seed: int, episodes: int, steps: int | None) -> Question:
    """Ask for a row of the tuned default in so many exponential steps; None: the policy's own."""
    return Question(
        task=task,
        method="CFPG",
        settings=tuned_default(task),
        seed=seed,
        episodes=episodes,
        episodes_seed=EVALUATION_SEED,
        exponential_steps=steps,
    )
