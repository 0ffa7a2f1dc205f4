"""Opens and computes a foreign graph once in a process of its own, before the robot's own process does."""

import functools
import sys
from pathlib import Path
from typing import Final

from edge_runtime.common.bounded_child import Bounds, ChildError, Task, result_of, work
from edge_runtime.errors import PolicyError
from edge_runtime.policy.onnx_policy import OnnxPolicy

BOUNDS: Final = Bounds(seconds=20, memory_mib=1024)
"""Far more than a policy that keeps any rate takes."""


class _Trial(Task, frozen=True, kw_only=True):
    graph: str
    action_dim: int
    observation_dim: int


@functools.cache
def try_graph(graph: Path, action_dim: int, observation_dim: int, bounds: Bounds = BOUNDS) -> None:
    """Find out, once a process, whether a graph can be computed in bounded time and memory.

    Arguments are those of `OnnxPolicy`.

    Raises:
        PolicyError: if it cannot, or takes more.
    """
    task = _Trial(bounds=bounds, graph=str(graph), action_dim=action_dim, observation_dim=observation_dim)
    try:
        result_of(__name__, task)
    except ChildError as error:
        told = str(error)
        raise PolicyError(told if told.startswith(f"{graph}: ") else f"{graph}: {told}") from error


def _try(trial: _Trial) -> str:
    OnnxPolicy(Path(trial.graph), trial.action_dim, trial.observation_dim, steps=1)
    return ""


if __name__ == "__main__":
    sys.exit(work(sys.argv[1:], _Trial, _try))
