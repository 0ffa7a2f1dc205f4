"""``python -m benchmarks oracle``: how much of each task anybody could satisfy, and how policies fail at it.

On the tables' own episodes. The guided policies of all seeds play them first; those that none
of them satisfies are planned for, with the full state and over all robots' actions. Interrupt it and start it
again as you like; ``chrt -i 0`` in front of it leaves the machine to others.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import torch
from rich.progress import Progress

from benchmarks.common.flags import COUNT, add_policies, make_parser
from benchmarks.common.result_file import read_result, write_result
from benchmarks.paper.evaluation import EVALUATION_SEED
from benchmarks.paper.oracle.oracle_page import write_oracle
from benchmarks.paper.oracle.questions import Oracle
from benchmarks.paper.policies import SEEDS
from benchmarks.paper.possible import ORACLE, Row
from benchmarks.paper.tasks import TASKS
from export.episodes.neighbourhood import Setting


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("oracle", __doc__)
    parser.add_argument("--tasks", nargs="*", choices=tuple(TASKS), default=tuple(TASKS), help="(all)")
    parser.add_argument("--episodes", type=COUNT, default=1000, help="(1000)")
    parser.add_argument("--seeds", type=COUNT, default=SEEDS, metavar="N", help=f"of the policies ({SEEDS})")
    add_policies(parser)
    parser.add_argument("--json", type=Path, default=ORACLE, metavar="FILE", help="the rows")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    setting = Setting(episodes=options.episodes, episodes_seed=EVALUATION_SEED)
    asked = [Oracle(task, setting, options.policies, options.seeds) for task in options.tasks]
    rows = read_result(options.json, list[Row], default=[])
    with Progress(disable=not sys.stderr.isatty()) as progress:
        for oracle in asked:
            bar = progress.add_task(oracle.task, total=None)
            for row in oracle.missing(rows):
                rows.append(row)
                write_result(options.json, rows)
                progress.advance(bar)
    answers = {oracle.task: (oracle.answers(rows), oracle.ended(rows)) for oracle in asked}
    print(write_oracle(answers, options.json.parent / "paper" / "oracle.md"))
    return 0
