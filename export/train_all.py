"""``python -m export.train_all``: train and export every policy of the paper's tables."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from edge_runtime.common.command_line import CommandParser, command
from edge_runtime.common.flag_types import whole_number
from export.schedule.cost import cost
from export.schedule.job import FRAMES, SEEDS, check_budget, jobs
from export.schedule.pool import pool, work_off
from export.training.request import ALGORITHMS

COUNT = whole_number(1, 10_000)
EPILOG = """\
Interrupt or kill it whenever you like: what is finished stays, the rest goes on from its last checkpoint. The
bundles come to lie in DIR/<scenario>/<algorithm>/seed-<n>/bundle.

examples:
  python -m export.train_all --out runs --jobs 2
  python -m export.train_all --out /shared/runs --dask tcp://head:8786     dask workers that see /shared, too
"""


@command("train_all")
def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; returns the exit code."""
    options = _parse(arguments)
    wanted = jobs(options.out, options.scenarios, options.algorithms, options.seeds)
    for job in wanted:
        check_budget(job)
    open_jobs = [job for job in wanted if not job.finished]
    failures = 0
    with pool(options.jobs, options.dask) as (executor, at_once):
        print(f"{len(wanted) - len(open_jobs)} of {len(wanted)} policies are finished", flush=True)
        if open_jobs:
            print(cost(open_jobs, at_once), flush=True)
        for job, failure in work_off(open_jobs, executor):
            failures += bool(failure)
            print(f"train_all: {failure}" if failure else f"finished {job.bundle}", flush=True)
            if left := [job for job in open_jobs if not job.finished]:
                print(cost(left, at_once), flush=True)
    return 1 if failures else 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = CommandParser(
        "python -m export.train_all", "Train and export each algorithm on each task.", EPILOG
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs"), metavar="DIR", help="where they go (default: %(default)s)")
    add("--jobs", type=COUNT, default=1, metavar="N", help="trained at once here (default: %(default)s)")
    add("--dask", metavar="ADDRESS", help="of a dask scheduler whose workers train instead, one a thread")
    add("--seeds", type=COUNT, default=SEEDS, metavar="N", help="0 to N - 1 (default: %(default)s)")
    add("--scenarios", nargs="*", choices=list(FRAMES), default=list(FRAMES), metavar="TASK")
    add("--algorithms", nargs="*", choices=list(ALGORITHMS), default=list(ALGORITHMS), metavar="NAME")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
