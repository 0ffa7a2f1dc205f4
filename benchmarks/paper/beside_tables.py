"""Robots that decide one by one beside the tables, which compute many at once: within their errors?"""

import math
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.flags import POLICIES
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.rows import Row
from benchmarks.paper.statistics import summarise
from benchmarks.paper.tuning import tuned_default
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.schema import WEIGHTS_FILE


def beside_tables(percent: float, error: float, bundle: Bundle, rows: Sequence[Row]) -> str:
    """Say what the tables have for a task, and for this very policy if it is one of theirs.

    Args:
        percent: multi-objective success as driven.
        error: its standard error.
        bundle: the packaged policy that drove.
        rows: of the tables.
    """
    training = bundle.manifest.training
    if training is None:
        return "the tables do not know this policy's task"
    settings = tuned_default(training.scenario)
    asked = [row for row in rows if (row.task, row.settings) == (training.scenario, settings)]
    most = max((row.episodes for row in asked), default=0)
    table = [row for row in asked if row.episodes == most]
    success = summarise([row.multi_objective_success for row in table])
    known = f"tables: {success} % over {len(table)} policies"
    directory = find_policy(POLICIES, training.scenario, training.algorithm, training.seed)
    same = _weights(directory) == _weights(bundle.directory)
    own = [row for row in table if same and row.policy == digest(directory)]
    if not own:
        return f"{known}, of which this is none"
    share = own[0].multi_objective_success
    theirs = 100.0 * math.sqrt(1e-4 * share * (100.0 - share) / most)
    apart = abs(percent - share) / max(math.hypot(error, theirs), 1e-9)
    return f"{known}, this one {share:.1f} +- {theirs:.1f} %: {apart:.1f} standard errors apart"


def _weights(directory: Path) -> bytes:
    return (directory / WEIGHTS_FILE).read_bytes()
