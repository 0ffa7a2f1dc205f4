"""``python -m benchmarks values``: what actions are worth to their tasks, for the ablation's rows of that.

Fits a network for every policy of the tuned default that has none yet, about a minute each. Interrupt it and
start it again as you like.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import torch

from benchmarks.common.flags import COUNT, add_policies, make_parser
from benchmarks.paper.policies import SEEDS, digest, find_policy, value_path
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import load_bundle
from export.values.action_value import load_value, save_value
from export.values.fit import fit_value


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("values", __doc__)
    parser.add_argument("--tasks", nargs="*", choices=tuple(TASKS), default=tuple(TASKS), help="(all)")
    parser.add_argument("--seeds", type=int, nargs="*", default=range(SEEDS), help="of the policies (all)")
    parser.add_argument("--jobs", type=COUNT, default=1, metavar="N", help="side by side (1)")
    add_policies(parser)
    options = parser.parse_args(arguments)
    asked = [(options.policies, task, seed) for task in options.tasks for seed in options.seeds]
    todo = [each for each in asked if not _known(*each)]
    with ProcessPoolExecutor(options.jobs) as pool:
        futures = [pool.submit(_fit, *each) for each in todo]
        try:
            for future in as_completed(futures):
                print(future.result())
        finally:
            pool.shutdown(cancel_futures=True)
    return 0


def _policy(policies: Path, task: str, seed: int) -> Path:
    return find_policy(policies, task, tuned_default(task).algorithm(task), seed)


def _known(policies: Path, task: str, seed: int) -> bool:
    """Whether a policy has one."""
    directory = _policy(policies, task, seed)
    try:
        load_value(value_path(load_bundle(directory)), digest(directory))
    except ConfigError:
        return False
    return True


def _fit(policies: Path, task: str, seed: int) -> Path:
    torch.set_num_threads(1)
    bundle = load_bundle(_policy(policies, task, seed))
    path = value_path(bundle)
    save_value(path, fit_value(bundle, task, digest(bundle.directory), seed))
    return path
