"""``python -m benchmarks samplers``: few steps of the exponential sampler against ten of Euler's.

The tables' episodes and policies again, the guidance as tuned, every row beside `paper`'s of the same policy.
Interrupt it and start it again as you like.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from benchmarks.common.flags import add_rows, make_parser
from benchmarks.paper import paper_command
from benchmarks.paper.evaluation import EVALUATION_SEED, evaluate
from benchmarks.paper.policies import SEEDS
from benchmarks.paper.rows import Question
from benchmarks.paper.samplers.samplers_page import write_samplers
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default

RESULTS = Path(__file__).parents[2] / "results" / "paper_samplers.json"
Way = tuple[int | None, dict[str, Any]]
"""Steps of the exponential sampler, Euler's own where None; what changes of the tuned guidance."""
CORRECTION: dict[str, Any] = {"mode": "correction"}
STRONG: dict[str, Any] = {"scale": 10.0}
WAYS: dict[str, tuple[Way, ...]] = {
    "navigation": ((None, {}), (3, {}), (3, CORRECTION), (3, STRONG)),
    "balance": ((None, {}), (3, {}), (3, CORRECTION)),
    "sampling": ((None, {}), (4, {}), (4, CORRECTION)),
}
"""Up to the fewest steps that are equivalent; the first is what all are compared with."""


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
        first, *others = [
            [question(task, seed, options.episodes, *way) for seed in options.seeds] for way in WAYS[task]
        ]
        reference = evaluate(first, options.reference, options.policies, options.jobs)
        rows = evaluate(list(chain(*others)), options.json, options.policies, options.jobs)
        tables[task] = [*reference, *rows]
    print(write_samplers(tables, options.json.parent / "paper" / "samplers.md"))
    return 0


def question(task: str, seed: int, episodes: int, steps: int | None, changes: Mapping[str, Any]) -> Question:
    """Ask for a row of the tuned default, changed, in so many exponential steps; None: the policy's own."""
    tuned = tuned_default(task)
    return Question(
        task=task,
        method="CFPG",
        settings=replace(tuned, guidance=replace(tuned.guidance, **changes)),
        seed=seed,
        episodes=episodes,
        episodes_seed=EVALUATION_SEED,
        exponential_steps=steps,
    )
